// tactus-chaos: causes faults in a running session of this machine, and checks that the session recovers.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <variant>

#include "realtime/process.hpp"
#include "realtime/standard_output.hpp"
#include "session/percentile.hpp"
#include "session/printable.hpp"
#include "tools/chaos/health.hpp"
#include "tools/chaos/network_faults.hpp"
#include "tools/chaos/plan.hpp"
#include "tools/chaos/programs.hpp"
#include "wire/address/command_line.hpp"
#include "wire/address/finite_range.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"

namespace {

using namespace tactus;
using namespace tactus::chaos;
using realtime::monotonic_ns;

constexpr char kExamples[] = R"(
Examples:
  tactus-chaos --session lab --domain 40
  tactus-chaos --session lab --domain 40 --only suspend --only loss --seconds 600 --seed 7

Without --restart it kills gateways only, which HRTCs start again. The faults loss and cut need root and nft, and affect
the packets that arrive at this machine, or at the network namespace of this program. Ctrl-C ends every fault. Users
feel the faults: do not run it while a person holds a device.
Exit status: 0 the session recovered from every fault without a violation, 1 it did not, or there was no fault, or the
output could not be written, 2 wrong input or no session, 130 interrupted.)";

constexpr auto kPollPeriod = std::chrono::milliseconds{10};
constexpr std::int64_t kSecond = 1'000'000'000;
constexpr std::int64_t kSearchNs = 20 * kSecond;  // for a session that is complete
constexpr std::int64_t kCalmNs = 2 * kSecond;     // in which the session has to be complete before the first fault
/// Part of the run after which the growth of memory is measured. Until then it grows because programs touch pages of
/// their memory for the first time.
constexpr double kWarmUp = 0.5;
/// Age from which the growth of a program is measured, s: one that was killed before has not touched these pages yet.
constexpr double kMinAge = 10;
constexpr std::chrono::seconds kMaxWriting{3};      // of a file, whose descriptor does not count as growth
constexpr std::int64_t kReferenceNs = 2 * kSecond;  // in which the users and participants of the reference are found

struct Options {
  wire::SessionAddress address;
  std::uint64_t seed = 1;
  double seconds = 60, pause = 4, patience = 20;
  std::vector<std::string> only;
  bool restart = false, with_devices = false;
  HealthSettings health;
  std::string json;
};

/// Thrown when a signal ends the program.
struct Interrupted {};

/// Reads the session, without a place in its roster.
class Observer {
 public:
  Observer(const wire::SessionAddress& address, const HealthSettings& settings)
      : participants_{address}, health_{participants_.origin(), settings} {}

  [[nodiscard]] Health& health() { return health_; }
  /// Waits at most kPollPeriod, and applies the samples that have arrived. Throws Interrupted.
  void receive() {
    for (const auto& arrived : inbox_.take(kPollPeriod))
      std::visit([&](const auto& sample) { health_.on_sample(sample, arrived.at_ns); }, arrived.sample);
    health_.tick(monotonic_ns());
    if (realtime::stop_signal()) throw Interrupted{};
  }
  void receive_for(double seconds) {
    const std::int64_t end_ns = monotonic_ns() + static_cast<std::int64_t>(seconds * 1e9);
    while (monotonic_ns() < end_ns) receive();
  }
  [[nodiscard]] std::uint64_t dropped() const { return inbox_.dropped(); }

 private:
  template <class Sample>
  wire::Reader<Sample> reader(const wire::TopicSpec<Sample>& topic) {
    return {participants_, topic, [this](Sample&& sample) { inbox_.put(std::move(sample)); }};
  }

  wire::Participants participants_;
  Health health_;
  wire::Inbox<std::variant<session::RosterEntry, session::ProbeState>> inbox_{1u << 14};
  // The readers are the last members, so that they are destroyed first: their callbacks use the inbox.
  wire::Reader<session::RosterEntry> roster_ = reader(wire::topics::kRoster);
  wire::Reader<session::ProbeState> states_ = reader(wire::topics::kProbeState);
};

/// A program after the first part of the run, or when it was kMinAge old if that was later.
struct Measured {
  Program program;
  Resources before;
};

class Run {
 public:
  explicit Run(const Options& options)
      : options_{options}, observer_{options.address, options.health}, network_{options.address.domain} {}

  /// Returns the exit status.
  int run() {
    const std::vector<FaultKind> kinds = possible_kinds();
    find_reference();
    Plan plan{options_.seed, kinds, options_.pause};
    const std::int64_t begin_ns = monotonic_ns(), end_ns = begin_ns + static_cast<std::int64_t>(options_.seconds * 1e9);
    std::printf("seed %llu, %g s of faults in session %s with %s\n", static_cast<unsigned long long>(options_.seed),
                options_.seconds, options_.address.session.c_str(),
                session::printable(observer_.health().reference_text()).c_str());
    bool has_selected = false;  // a fault
    try {
      while (monotonic_ns() < end_ns) {
        measure_programs(static_cast<double>(monotonic_ns() - begin_ns) * 1e-9 < kWarmUp * options_.seconds);
        const Fault fault = plan.next(found_programs());
        has_selected = true;
        observer_.receive_for(fault.pause);
        std::printf("%7.1f s  %s", static_cast<double>(monotonic_ns() - begin_ns) * 1e-9,
                    session::printable(text(fault)).c_str());
        std::fflush(stdout);
        apply(fault);
      }
    } catch (const NoPossibleFault& error) {
      // Without any possible fault, the input is wrong. Ctrl-C may also have ended all programs of the session.
      if (!has_selected || realtime::stop_signal()) throw;
      ++unrecovered_;
      std::printf("NOT RECOVERED: %s\n", session::printable(error.what()).c_str());
    } catch (const NotRestarted& error) {
      if (realtime::stop_signal()) throw;
      ++recoveries_[FaultKind::kKill].faults;
      ++unrecovered_;
      std::printf(": NOT RECOVERED: %s\n", session::printable(error.what()).c_str());
    }
    report();
    if (recoveries_.empty()) std::printf("no fault was caused, so the run shows nothing\n");
    return !recoveries_.empty() && unrecovered_ == 0 && observer_.health().violations().empty() ? 0 : 1;
  }

 private:
  [[nodiscard]] std::vector<FaultKind> possible_kinds() const {
    const std::string obstacle = NetworkFaults::obstacle();
    std::vector<FaultKind> kinds;
    for (std::size_t i = 0; i < kFaultKinds; ++i) {
      const auto kind = static_cast<FaultKind>(i);
      const bool is_named = std::count(options_.only.begin(), options_.only.end(), name(kind)) > 0;
      if (!options_.only.empty() && !is_named) continue;
      if ((kind == FaultKind::kLoss || kind == FaultKind::kCut) && !obstacle.empty()) {
        if (is_named) throw std::runtime_error(std::string{"no fault "} + name(kind) + ": " + obstacle);
        std::printf("without the fault %s: %s\n", name(kind), obstacle.c_str());
        continue;
      }
      kinds.push_back(kind);
    }
    return kinds;
  }

  /// Returns the programs of the session. Throws std::runtime_error if a person may hold one of their devices.
  [[nodiscard]] std::vector<Program> found_programs() const {
    const std::vector<Program> programs =
        programs_of(options_.address.session, options_.address.domain, options_.restart);
    for (const Program& program : programs)
      if (program.has_driver && !options_.with_devices)
        throw std::runtime_error(program.label + " has a device that a person may hold; --with-devices permits it");
    return programs;
  }

  /// Waits until the session is complete, and remembers who takes part.
  void find_reference() {
    Health& health = observer_.health();
    observer_.receive_for(static_cast<double>(kReferenceNs) * 1e-9);
    const std::int64_t end_ns =
        monotonic_ns() + std::max(kSearchNs, static_cast<std::int64_t>(options_.patience * 1e9));
    for (std::int64_t calm_since_ns = 0; calm_since_ns == 0 || monotonic_ns() - calm_since_ns < kCalmNs;) {
      if (calm_since_ns == 0) health.set_reference(monotonic_ns());
      observer_.receive();
      const std::vector<std::string> missing = health.missing(monotonic_ns());
      if (health.reference_text().empty() || !missing.empty())
        calm_since_ns = 0;
      else if (calm_since_ns == 0)
        calm_since_ns = monotonic_ns();
      if (monotonic_ns() < end_ns) continue;
      if (health.reference_text().empty())
        throw std::runtime_error("found nobody in session " + options_.address.session + ", domain " +
                                 std::to_string(options_.address.domain));
      throw std::runtime_error("the session was not complete for 2 s before any fault" +
                               (missing.empty() ? std::string{} : "; missing: " + missing.front()));
    }
    if (found_programs().empty())
      throw std::runtime_error("no program of session " + options_.address.session +
                               " runs on this machine, or they belong to another user");
    if (!health.has_users()) std::printf("there is no user, so forces and contacts are not checked\n");
  }

  /// Measures the programs that are old enough. During the warm-up again each time: growth is that over the largest
  /// memory, because a program that is suspended or cut off stores less for a while, such as an HRTC in its recorder.
  void measure_programs(bool is_warm_up) {
    for (const Program& program : found_programs()) {
      const auto known = std::find_if(measured_.begin(), measured_.end(), [&](const Measured& measured) {
        return measured.program.pid == program.pid && measured.program.started == program.started;
      });
      if ((known != measured_.end() && !is_warm_up) || age_of(program) < kMinAge) continue;
      auto resources = resources_of(program);
      if (!resources) continue;
      if (known == measured_.end()) {
        measured_.push_back({program, *resources});
      } else {
        resources->resident_mb = std::max(resources->resident_mb, known->before.resident_mb);
        known->before = *resources;
      }
    }
  }

  void apply(const Fault& fault) {
    if (fault.program.empty()) {
      network_.lose(fault.kind == FaultKind::kCut ? 100 : fault.percent, fault.seconds);
      const std::int64_t end_ns =
          monotonic_ns() + static_cast<std::int64_t>(fault.seconds * 1e9);  // then the kernel ends the fault
      observer_.receive_for(fault.seconds);
      network_.end();
      return wait_for_recovery(fault, end_ns);
    }
    const std::vector<Program> programs = found_programs();
    const auto affected = std::find_if(programs.begin(), programs.end(), [&](const Program& program) {
      return program.label == fault.program && applies(fault.kind, program);
    });
    try {
      if (affected == programs.end()) throw ProgramEnded{"it has ended"};
      if (fault.kind == FaultKind::kSuspend) {
        const Suspension suspension{*affected, fault.seconds};
        observer_.receive_for(fault.seconds);
      } else {
        kill_and_restart(*affected);
      }
    } catch (const ProgramEnded& ended) {
      std::printf(": %s", session::printable(ended.what()).c_str());
      std::fflush(stdout);
      return wait_for_recovery(fault, monotonic_ns(), Cause::kOther);
    }
    wait_for_recovery(fault, monotonic_ns());
  }

  /// The cause of an interruption: a fault of this program, or the end of a program by another cause, which is not
  /// counted as a fault.
  enum class Cause { kFault, kOther };

  void wait_for_recovery(const Fault& fault, std::int64_t end_ns, Cause cause = Cause::kFault) {
    // The observer may not have noticed a fault that has just begun: a silent participant is late after 0.25 s.
    constexpr double kNoticeSeconds = 0.4;
    const std::int64_t limit_ns = end_ns + static_cast<std::int64_t>(options_.patience * 1e9);
    std::int64_t back_ns = end_ns;
    std::vector<std::string> missing;
    std::string last_missing;
    do {
      observer_.receive();
      missing = observer_.health().missing(monotonic_ns());
      if (!missing.empty()) {
        back_ns = monotonic_ns();
        last_missing = missing.front();
      }
      if (monotonic_ns() > limit_ns) break;
    } while (!missing.empty() ||
             static_cast<double>(monotonic_ns() - std::max(back_ns, end_ns)) * 1e-9 < kNoticeSeconds);
    if (cause == Cause::kFault) ++recoveries_[fault.kind].faults;
    if (!missing.empty()) {
      ++unrecovered_;
      std::printf(": NOT RECOVERED after %g s: %s\n", options_.patience, session::printable(missing.front()).c_str());
      return;
    }
    constexpr double kLongSeconds = 1;
    const double seconds = static_cast<double>(back_ns - end_ns) * 1e-9;
    if (cause == Cause::kFault) recoveries_[fault.kind].seconds.add(seconds);
    std::printf(": complete %.2f s after its end%s\n", seconds,
                seconds < kLongSeconds ? "" : ("; missing until then: " + session::printable(last_missing)).c_str());
  }

  void report() {
    const Health& health = observer_.health();
    nlohmann::json json{{"seed", options_.seed},
                        {"seconds", options_.seconds},
                        {"states", health.states()},
                        {"max_force", health.max_force()},
                        {"unrecovered", unrecovered_},
                        {"violations", health.violations()},
                        {"faults", nlohmann::json::array()},
                        {"programs", nlohmann::json::array()}};
    std::printf("\n%-10s%8s%14s%14s%14s\n", "fault", "times", "recovered", "median, s", "max, s");
    for (const auto& [kind, recovery] : recoveries_) {
      nlohmann::json result{{"kind", name(kind)},  // without a maximum if the session did not recover from one of them
                            {"times", recovery.faults},
                            {"recovered", recovery.seconds.size()},
                            {"median_s", nullptr},
                            {"max_s", nullptr}};
      std::printf("%-10s%8zu%14zu", name(kind), recovery.faults, recovery.seconds.size());
      if (recovery.seconds.size() == recovery.faults) {
        const double median = recovery.seconds.percentile(0.5), max = recovery.seconds.max();
        result["median_s"] = median;
        result["max_s"] = max;
        std::printf("%14.2f%14.2f\n", median, max);
      } else {
        std::printf("%14s%14s\n", "-", "-");
      }
      json["faults"].push_back(std::move(result));
    }
    std::printf("\n%-24s%16s%12s%14s%8s\n", "program", "resident, MB", "growth", "descriptors", "growth");
    for (const auto& [program, before] : measured_) {
      const auto after = settled_resources_of(program, before.descriptors, kMaxWriting);
      if (!after) continue;
      const double growth = after->resident_mb - before.resident_mb;
      const long more = static_cast<long>(after->descriptors) - static_cast<long>(before.descriptors);
      std::printf("%-24s%16.1f%+12.1f%14zu%+8ld\n", session::printable(program.label).c_str(), after->resident_mb,
                  growth, after->descriptors, more);
      json["programs"].push_back({{"label", program.label},
                                  {"resident_mb", after->resident_mb},
                                  {"growth_mb", growth},
                                  {"descriptors", after->descriptors},
                                  {"descriptors_growth", more}});
    }
    std::printf("\n%llu probe states, largest force %.2f N\n", static_cast<unsigned long long>(health.states()),
                health.max_force());
    for (const std::string& violation : health.violations())
      std::printf("violation: %s\n", session::printable(violation).c_str());
    if (observer_.dropped() > 0)
      std::printf("this machine is too slow: %llu samples were not read, so results may be too bad\n",
                  static_cast<unsigned long long>(observer_.dropped()));
    if (options_.json.empty()) return;
    std::ofstream file{options_.json};
    // Names and labels may not be UTF-8.
    file << json.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) << '\n';
    if (!file.flush()) throw std::runtime_error("cannot write " + options_.json);
  }

  struct Recovery {
    std::size_t faults = 0;
    session::Samples<> seconds;  // of those from which the session recovered
  };

  const Options& options_;
  Observer observer_;
  NetworkFaults network_;
  std::vector<Measured> measured_;
  std::map<FaultKind, Recovery> recoveries_;
  std::size_t unrecovered_ = 0;
};

}  // namespace

int main(int argc, char** argv) {
  Options options;
  options.address.session = "tactus";
  options.address.participant = "chaos-" + std::to_string(getpid());
  options.address.naming = wire::Naming::kInstance;
  options.address.only_reads_bulk = true;
  CLI::App app{"Causes faults in a running session of this machine, and checks that the session recovers.",
               "tactus-chaos"};
  app.footer(kExamples);
  wire::add_address_options(app, options.address, "program");
  std::vector<std::string> kinds;
  for (std::size_t i = 0; i < kFaultKinds; ++i) kinds.emplace_back(name(static_cast<FaultKind>(i)));
  app.add_option("--only", options.only, "Cause faults of this kind; repeatable; default: all that are possible")
      ->check(CLI::IsMember(kinds));
  app.add_option("--seed", options.seed, "Number that selects the faults")->capture_default_str();
  app.add_option("--seconds", options.seconds, "Time in which faults begin")
      ->capture_default_str()
      ->check(wire::finite_range(0.0, 1e6));
  app.add_option("--pause", options.pause, "Max seconds from a recovery to the next fault")
      ->capture_default_str()
      ->check(wire::finite_range(0.0, 3600.0));
  app.add_option("--patience", options.patience, "Seconds in which the session has to recover from a fault")
      ->capture_default_str()
      ->check(wire::finite_range(0.5, 3600.0));
  app.add_flag("--restart", options.restart, "Also kill hosts and HRTCs, and start them again with their command");
  app.add_flag("--with-devices", options.with_devices, "Permit faults although an HRTC has a device with a driver");
  app.add_option("--max-force", options.health.max_force, "Largest force that a probe may have, N")
      ->capture_default_str()
      ->check(wire::finite_positive());
  app.add_option("--json", options.json, "Also write the results to this file");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  (void)realtime::stop_signal();
  std::signal(SIGPIPE, SIG_IGN);  // Ctrl-C also ends nft
  try {
    return realtime::status_after_output("tactus-chaos", Run{options}.run());
  } catch (const Interrupted&) {
    std::printf("\ninterrupted: every fault has ended\n");
    return 130;
  } catch (const std::exception& error) {
    if (realtime::stop_signal()) return 130;  // it has interrupted a step
    std::cerr << "tactus-chaos: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
