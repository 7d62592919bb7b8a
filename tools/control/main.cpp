// tactus-control: publishes emergency stops, resets, modes, and the end of a session.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "session/modes.hpp"
#include "session/printable.hpp"
#include "session/stop_latch.hpp"
#include "session/units.hpp"
#include "wire/address/command_line.hpp"
#include "wire/address/finite_range.hpp"
#include "wire/endpoints.hpp"
#include "wire/inbox.hpp"

namespace {

using namespace tactus;
using realtime::monotonic_ns;
using std::chrono::milliseconds;

constexpr char kExamples[] = R"(
Examples:
  tactus-control stop --session lab --domain 40 --reason "needle bent"
  tactus-control stop --local
  tactus-control reset --session lab --domain 40
  tactus-control mode "collaborate ann,bob" --session lab --domain 40

A stop sets every force in the session to zero at once. Forces remain off until a reset, which starts them softly. A
reset ends the stops that are in force when it begins. It does not end later stops. With --local, every HRTC on this
machine gets the signal SIGUSR2, which works without a network. The sessions of these HRTCs then stop too.
Exit status: 0 acknowledged by all hosts and HRTCs, at least one of them an HRTC (mode and end: received by all; --local:
signalled all HRTCs, at least one), 1 not acknowledged by all, or another stop is still in force, 2 wrong input,
130 interrupted.)";

/// Period at which a stop or a reset is repeated.
constexpr milliseconds kRepeatPeriod{20};
/// Time from the discovery of the first host or HRTC until all are assumed discovered, because discovery reports no
/// end.
constexpr std::int64_t kDiscoveryNs = 1500 * kMs;
/// Time from the discovery of the first host or HRTC until a reset reads the stops in force: five heartbeats.
constexpr std::int64_t kReadStopsNs = 500 * kMs;

struct Request {
  std::string text;
  double patience = 5;  // s
};

std::string join(const std::vector<std::string>& names) {
  std::string all;
  for (const std::string& name : names) all += " " + session::printable(name);
  return all.empty() ? " none" : all;
}

/// One run of this program in a session, with the hosts and HRTCs that it finds.
class Session {
 public:
  Session(const wire::SessionAddress& address, double patience, const std::atomic<bool>& cancelled)
      : participants_{address},
        roster_{participants_.origin(), {}},
        cancelled_{cancelled},
        end_ns_{monotonic_ns() + static_cast<std::int64_t>(patience * 1e9)} {}

  [[nodiscard]] wire::Participants& participants() { return participants_; }
  [[nodiscard]] const session::Roster& roster() const { return roster_; }
  [[nodiscard]] bool interrupted() const { return cancelled_; }

  /// Receives roster entries for `time`. Returns false when interrupted or after `patience`.
  [[nodiscard]] bool wait(milliseconds time) {
    const std::int64_t until_ns = monotonic_ns() + time.count() * kMs;
    for (std::int64_t now_ns = monotonic_ns(); now_ns < until_ns && !cancelled_; now_ns = monotonic_ns()) {
      const auto left = std::chrono::microseconds{(until_ns - now_ns + 999) / 1000};
      for (const auto& arrived : inbox_.take(left)) (void)roster_.on_entry(arrived.sample, arrived.at_ns);
    }
    const std::int64_t now_ns = monotonic_ns();
    (void)roster_.tick(now_ns);
    recipients_.update(roster_);
    if (found_ns_ == 0 && acting() > 0) found_ns_ = now_ns;
    return !cancelled_ && now_ns < end_ns_;
  }
  /// Returns whether the first host or HRTC was found at least `ns` ago.
  [[nodiscard]] bool found_for(std::int64_t ns) const { return found_ns_ != 0 && monotonic_ns() - found_ns_ >= ns; }
  [[nodiscard]] bool found() const { return found_ns_ != 0; }

  /// Publishes the sample repeatedly until every host and HRTC has acknowledged it, or wait() returns false.
  template <class Sample>
  session::Acknowledgement deliver(wire::Writer<Sample>& out, Sample sample) {
    session::Acknowledgement answer;
    do {
      sample.origin = participants_.origin();
      if (out.send(sample) == wire::SendStatus::kInvalid)
        throw std::runtime_error(std::string{"the sample was not sent: "} + out.invalid_reason());
      answer = recipients_.acknowledgement(sample);
    } while (!(answer.missing.empty() && found_for(kDiscoveryNs)) && wait(kRepeatPeriod));
    return answer;
  }

 private:
  [[nodiscard]] std::size_t acting() const {
    std::size_t count = 0;
    roster_.for_each([&](const session::RosterEntry& entry) { count += session::lists_stops(entry) ? 1 : 0; });
    return count;
  }

  wire::Participants participants_;
  session::Roster roster_;
  session::Recipients recipients_;
  const std::atomic<bool>& cancelled_;
  const std::int64_t end_ns_;
  std::int64_t found_ns_ = 0;  // time at which the first host or HRTC was found; 0: none yet
  wire::Inbox<session::RosterEntry> inbox_{1u << 12};
  wire::Reader<session::RosterEntry> reader_{
      // last, so that its callback does not outlive the inbox
      participants_, wire::topics::kRoster, [this](session::RosterEntry&& entry) { inbox_.put(std::move(entry)); }};
};

int report_none_found(const wire::SessionAddress& address, double patience) {
  std::cerr << "tactus-control: no host or HRTC found in session " << address.session << ", domain " << address.domain
            << ", within " << patience << " s\n";
  return 1;
}

/// Prints which participants acknowledged and which did not. Returns the exit status.
int report(const session::Acknowledgement& answer) {
  std::cout << "acknowledged by HRTCs:" << join(answer.hrtcs) << "; by hosts:" << join(answer.hosts) << '\n';
  if (!answer.missing.empty()) std::cout << "not acknowledged by:" << join(answer.missing) << '\n';
  return answer.missing.empty() && !answer.hrtcs.empty() ? 0 : 1;
}

int stop_forces(const wire::SessionAddress& address, const Request& request, const std::atomic<bool>& cancelled) {
  Session session{address, request.patience, cancelled};
  wire::Writer<session::EmergencyStop> out{session.participants(), wire::topics::kStop};
  const session::Acknowledgement answer = session.deliver(out, {session.participants().origin(), 1, request.text});
  if (session.interrupted()) return 130;
  return session.found() ? report(answer) : report_none_found(address, request.patience);
}

/// Signals a stop to each HRTC on this machine. Needs no network.
int stop_local_hrtcs() {
  int signalled = 0, failed = 0;
  for (const auto& process : std::filesystem::directory_iterator{"/proc"}) {
    std::string name;
    if (!std::getline(std::ifstream{process.path() / "comm"}, name) || name != "tactus-hrtc") continue;
    const int id = std::stoi(process.path().filename());
    const bool sent = kill(id, SIGUSR2) == 0;
    if (!sent && errno == ESRCH) continue;  // it has ended
    ++(sent ? signalled : failed);
    if (sent)
      std::cout << "signalled a stop to the HRTC with process id " << id << '\n';
    else
      std::cerr << "tactus-control: the HRTC with process id " << id
                << " was not signalled: " << std::generic_category().message(errno) << "; it may run as another user\n";
  }
  if (signalled + failed == 0) std::cerr << "tactus-control: no HRTC found on this machine\n";
  return failed == 0 && signalled > 0 ? 0 : 1;
}

int reset_forces(const wire::SessionAddress& address, const Request& request, const std::atomic<bool>& cancelled) {
  Session session{address, request.patience, cancelled};
  wire::Writer<session::ForceReset> out{session.participants(), wire::topics::kReset};
  while (!session.found_for(kReadStopsNs) && session.wait(kRepeatPeriod)) {
  }
  if (session.interrupted()) return 130;
  if (!session.found()) return report_none_found(address, request.patience);
  const std::vector<session::StopName> stops = session::standing_stops(session.roster());
  std::cout << "resets " << stops.size() << (stops.size() == 1 ? " stop\n" : " stops\n");
  session::Acknowledgement answer;
  std::size_t named = 0;
  std::uint32_t number = 0;
  do {
    session::ForceReset reset;
    reset.number = ++number;
    for (; named < stops.size() && reset.stops.size() < session::kMaxStops; ++named)
      reset.stops.push_back(stops[named]);
    reset.text = request.text;
    answer = session.deliver(out, reset);
  } while (named < stops.size() && answer.missing.empty());
  if (session.interrupted()) return 130;
  const int status = report(answer);
  std::size_t still = 0;
  session.roster().for_each([&](const session::RosterEntry& entry) {
    if (!session::lists_stops(entry)) return;
    const std::size_t left = session::standing_stops(entry.stops).size();
    if (left > 0)
      std::cout << session::printable(entry.name) << ": " << left
                << " stops that this reset did not name are still in force\n";
    still += left;
  });
  return still == 0 ? status : 1;
}

/// Publishes a sample that only DDS acknowledges, not the roster. Returns the exit status.
template <class Sample>
int announce(const wire::SessionAddress& address, const wire::TopicSpec<Sample>& topic, const Request& request,
             Sample sample, const std::atomic<bool>& cancelled) {
  wire::Participants participants{address};
  wire::Writer<Sample> out{participants, topic};
  sample.origin = participants.origin();
  // The writer stores the sample for readers that it discovers later, so it may send before it has discovered one.
  if (out.send(sample) != wire::SendStatus::kSent)
    throw std::runtime_error(std::string{"the sample was not sent: "} + out.invalid_reason());
  const std::int64_t end_ns = monotonic_ns() + static_cast<std::int64_t>(request.patience * 1e9);
  std::optional<std::int64_t> found_ns;
  int received = 0;  // maximum number of matched readers, because programs leave after an end
  while (!cancelled && monotonic_ns() < end_ns && (!found_ns || monotonic_ns() - *found_ns < kDiscoveryNs)) {
    received = std::max(received, out.matched());
    if (!found_ns && received > 0) found_ns = monotonic_ns();
    std::this_thread::sleep_for(kRepeatPeriod);  // nothing notifies of a match
  }
  if (cancelled) return 130;
  if (!found_ns) return report_none_found(address, request.patience);
  const bool all = out.wait_acknowledged(std::chrono::seconds{1});
  std::cout << "received by " << received << " programs" << (all ? "" : "; not all have confirmed it") << '\n';
  return all ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  wire::SessionAddress address;
  address.participant = "control-" + std::to_string(getpid());
  address.naming = wire::Naming::kInstance;
  Request request;
  CLI::App app{"Sends an emergency stop, reset, mode or end to all programs of a session.", "tactus-control"};
  app.footer(kExamples);
  app.require_subcommand(1);
  app.fallthrough();
  wire::add_address_options(app, address, "program");
  app.add_option("--patience", request.patience, "Seconds to wait for hosts and HRTCs and for acknowledgements")
      ->capture_default_str()
      ->check(wire::finite_range(0.1, 3600.0));
  const auto with_reason = [&](CLI::App* sub) {
    sub->add_option("--reason", request.text, "Text for the logs and reports of all programs")
        ->check([](const std::string& text) -> std::string {
          return text.size() <= session::kMaxText ? ""
                                                  : "expected at most " + std::to_string(session::kMaxText) + " bytes";
        });
    return sub;
  };
  CLI::App* const stop =
      with_reason(app.add_subcommand("stop", "Emergency stop: set every force to zero at once, until a reset"));
  bool is_local = false;
  stop->add_flag("--local", is_local, "Stop every HRTC on this machine by a signal, without a network")
      ->excludes(stop->get_option("--reason"));
  const CLI::App* const reset = with_reason(
      app.add_subcommand("reset", "End the stops now in force and the faults of devices; forces start softly"));
  const CLI::App* const end =
      with_reason(app.add_subcommand("end", "End the session: its programs write their reports and leave"));
  app.add_subcommand("mode", "Set the session mode of all users or of some")
      ->add_option("MODE", request.text,
                   "auto, collaborate or large-scale; the last two may be followed by USER,USER..., as for tactus-sim "
                   "--mode")
      ->required();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    const std::atomic<bool>& interrupted = realtime::stop_signal();
    if (is_local) return stop_local_hrtcs();
    address.discovery.skips_unknown_peers = stop->parsed();
    if (stop->parsed()) return stop_forces(address, request, interrupted);
    if (reset->parsed()) return reset_forces(address, request, interrupted);
    if (end->parsed()) return announce(address, wire::topics::kEnd, request, {{}, request.text}, interrupted);
    (void)session::parse_mode(request.text);  // the HRTCs only log a wrong mode
    return announce(address, wire::topics::kControl, request, {{}, 1, session::ControlKind::kMode, request.text},
                    interrupted);
  } catch (const std::exception& error) {
    std::cerr << "tactus-control: " << session::printable(error.what()) << '\n';
    return 2;
  }
}
