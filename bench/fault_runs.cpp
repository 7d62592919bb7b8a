#include "bench/fault_runs.hpp"

#include <arpa/inet.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <thread>

#include "bench/cycle_log.hpp"
#include "bench/flight_cycles.hpp"
#include "bench/live_session.hpp"
#include "bench/touched_session.hpp"
#include "tools/chaos/programs.hpp"
#include "trace/mcap.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
using netem::Side;
using Process = e2e::Process;

double ms_since(std::int64_t begin_ns) { return static_cast<double>(realtime::monotonic_ns() - begin_ns) * 1e-6; }

double resident_mb(pid_t pid) {
  std::ifstream file{"/proc/" + std::to_string(pid) + "/statm"};
  double total = 0, resident = 0;
  if (!(file >> total >> resident)) throw std::runtime_error("process " + std::to_string(pid) + " has ended");
  return resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) * 1e-6;
}

/// Sends packets of random bytes to the ports of the programs in a namespace, until it is destroyed.
class Flood {
 public:
  Flood(const netem::LinkedPair& pair, Side from, int domain, std::uint64_t seed)
      : thread_{[this, &pair, from, domain, seed] {
          try {
            pair.enter_namespace(from);
            send_until_stopped(domain, seed);
          } catch (const std::exception& error) {
            std::fprintf(stderr, "%s\n", error.what());  // no packet is sent, so the row of the rate falls short
          }
        }} {}
  ~Flood() {
    stop_ = true;
    thread_.join();
  }
  Flood(const Flood&) = delete;
  Flood& operator=(const Flood&) = delete;
  /// Number of packets that the system has accepted.
  [[nodiscard]] std::uint64_t sent() const noexcept { return sent_; }

 private:
  void send_until_stopped(int domain, std::uint64_t seed) {
    constexpr int kPerMs = 10, kDomains = 3, kPrograms = 3;  // host, HRTC and observer
    constexpr std::array kOffsets{0, 10, 11};  // of the ports: discovery by multicast; discovery and data of a program
    const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    std::mt19937_64 random{seed};
    sockaddr_in to{};
    to.sin_family = AF_INET;
    std::array<std::uint8_t, 1400> bytes{};
    for (std::int64_t next_ns = realtime::monotonic_ns(); !stop_; next_ns += 1'000'000) {
      for (int i = 0; i < kPerMs; ++i) {
        const std::size_t size = 20 + random() % (bytes.size() - 20);
        for (std::size_t at = 0; at < size; at += 8) {
          const std::uint64_t value = random();
          std::memcpy(bytes.data() + at, &value, std::min<std::size_t>(8, size - at));
        }
        // Half of the packets have the header of a message of Fast DDS, so that more of the receiver's code reads them.
        if (random() % 2 == 0) std::memcpy(bytes.data(), "RTPS\x02\x03\x01\x0f", 8);
        const int offset = kOffsets[random() % kOffsets.size()];
        const int program = offset < 10 ? 0 : 2 * static_cast<int>(random() % kPrograms);
        const int port = 7400 + 250 * (domain + static_cast<int>(random() % kDomains)) + offset + program;
        to.sin_port = htons(static_cast<std::uint16_t>(port));
        to.sin_addr.s_addr = ::inet_addr(offset < 10 ? "239.255.0.1" : netem::LinkedPair::address(Side::kB));
        if (::sendto(socket, bytes.data(), size, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to) > 0) ++sent_;
      }
      const std::int64_t left_ns = next_ns + 1'000'000 - realtime::monotonic_ns();
      if (left_ns > 0) std::this_thread::sleep_for(std::chrono::nanoseconds{left_ns});  // the rate of the flood
    }
    ::close(socket);
  }

  std::atomic<bool> stop_{false};
  std::atomic<std::uint64_t> sent_{0};
  std::thread thread_;
};

/// A file system of 4 MB in memory, until it is destroyed.
class SmallDisk {
 public:
  explicit SmallDisk(std::filesystem::path folder) : folder_{std::move(folder)} {
    std::filesystem::create_directory(folder_);
    if (::mount("tmpfs", folder_.c_str(), "tmpfs", 0, "size=4m") != 0)
      throw std::runtime_error("cannot mount a file system of 4 MB: " + std::string{std::strerror(errno)});
  }
  ~SmallDisk() { ::umount2(folder_.c_str(), MNT_DETACH); }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  [[nodiscard]] const std::filesystem::path& folder() const noexcept { return folder_; }

 private:
  std::filesystem::path folder_;
};

std::size_t count_of(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (std::size_t at = 0; (at = text.find(part, at)) != std::string::npos; at += part.size()) ++count;
  return count;
}

/// The poses of an object since the last call of `forget`, from all programs.
class PoseObserver {
 public:
  explicit PoseObserver(const wire::SessionAddress& address)
      : participants_{address}, poses_{participants_, wire::topics::kObjectPose, [this](session::ObjectPose&& pose) {
                                         const std::lock_guard lock{mutex_};
                                         arrived_.push_back({realtime::monotonic_ns(), std::move(pose)});
                                       }} {}
  struct Arrived {
    std::int64_t at_ns;
    session::ObjectPose pose;
  };
  [[nodiscard]] std::vector<Arrived> arrived() const {
    const std::lock_guard lock{mutex_};
    return arrived_;
  }
  [[nodiscard]] std::optional<Arrived> first_from(const std::string& participant) const {
    const std::lock_guard lock{mutex_};
    const auto found = std::find_if(arrived_.begin(), arrived_.end(), [&](const Arrived& arrived) {
      return arrived.pose.origin.participant == session::id_of(participant);
    });
    return found == arrived_.end() ? std::nullopt : std::optional{*found};
  }
  void forget() {
    const std::lock_guard lock{mutex_};
    arrived_.clear();
  }

 private:
  wire::Participants participants_;
  mutable std::mutex mutex_;
  std::vector<Arrived> arrived_;
  wire::Reader<session::ObjectPose> poses_;
};

enum class WrongClock { kAhead, kBehind };

/// Returns whether all programs have a reference of session time, and their session times differ by less than 1 ms.
template <class AheadNs>
bool have_one_session_time(const ObservedSession& observed, const AheadNs& ahead_ns) {
  std::int64_t least = INT64_MAX, most = INT64_MIN;
  for (const auto& [id, entry] : observed.roster) {
    if (entry.reference == 0) return false;
    least = std::min(least, ahead_ns(entry));
    most = std::max(most, ahead_ns(entry));
  }
  return !observed.roster.empty() && most - least < 1'000'000;
}

/// Compares the ages of the states of an HRTC with a wrong clock with those of an HRTC with the clock of the host.
void measure_clock(const FaultSettings& settings, WrongClock clock, Report& report) {
  constexpr std::int64_t kHour = 3600;  // s
  const bool is_behind = clock == WrongClock::kBehind;
  TouchedSession touched;
  LiveSession& session = touched.session();
  // The programs of a time namespace have another monotonic clock. A clock cannot be before the start of the machine.
  // So the other programs are ahead of the HRTC whose clock is behind.
  const std::vector<std::string> ahead{"/usr/bin/unshare", "--time", "--monotonic", std::to_string(kHour), "--fork"};
  const auto start = [&](Side side, const std::string& name, const std::vector<std::string>& arguments, bool is_ahead) {
    return session.start(side, name, arguments, is_ahead ? ahead : std::vector<std::string>{});
  };
  const auto host = start(Side::kA, "host", {"--name", "museum", touched.path("organ.spm")}, is_behind);
  const auto right = start(Side::kB, "hrtc", touched.hrtc_arguments("right", {"bob"}, {"--no-coding"}), is_behind);
  const auto wrong = start(Side::kB, "hrtc", touched.hrtc_arguments("wrong", {"ann"}, {"--no-coding"}), !is_behind);
  touched.wait_for_touch("ann");
  touched.wait_for_touch("bob");
  // An entry states the session time that belongs to its program's clock. Returns how far it is ahead of the clock of
  // this program.
  const auto session_ahead_ns = [&](const session::RosterEntry& entry) {
    const bool is_wrong = entry.name == "wrong";
    return entry.session_time_ns - (entry.origin.time_ns - (is_wrong == is_behind ? 0 : kHour * 1'000'000'000));
  };
  // Both users touch before there is a reference of session time, so their clocks slew to it.
  session.wait_until(
      "one session time", [&](const ObservedSession& now) { return have_one_session_time(now, session_ahead_ns); },
      60s);
  pause(2s);
  session.forget_states();
  pause(std::chrono::milliseconds{static_cast<long>(settings.seconds * 1e3 / 6)});
  const ObservedSession observed = session.observed();
  const std::int64_t ahead_ns = session_ahead_ns(observed.roster.at(session::id_of("museum")));
  std::map<std::uint64_t, Samples> ages_ms;
  for (const ObservedSession::State& state : observed.states)
    ages_ms[state.user].add(static_cast<double>(state.received_ns + ahead_ns - state.time_ns) * 1e-6);
  const Samples &ann = ages_ms[session::id_of("ann")], &bob = ages_ms[session::id_of("bob")];
  const std::string wrong_clock = is_behind ? "HRTC with a clock an hour behind" : "HRTC with a clock an hour ahead";
  const Population states{"states", ann.size()};
  report.add_percentiles("age of states, " + wrong_clock, "states", "ms", ann);
  report.add_percentiles("age of states, HRTC with the clock of the host, beside an " + wrong_clock, "states", "ms",
                         bob);
  report.add_at_least("min age of states, " + wrong_clock, states, "ms", ann.percentile(0), 0);
  report.add_at_most("difference of the median ages, " + wrong_clock, states, "ms",
                     std::abs(ann.percentile(0.5) - bob.percentile(0.5)), 0.5);
}

}  // namespace

void measure_killed_hrtc(const FaultSettings& settings, Report& report) {
  TouchedSession touched;
  LiveSession& session = touched.session();
  touched.start_host(Side::kA);
  const auto left = touched.start_hrtc(Side::kA, "left", {"ann"});
  auto right = touched.start_hrtc(Side::kB, "right", {"bob"});
  touched.wait_for_touch("ann");
  touched.wait_for_touch("bob");
  Samples gone_ms, ready_ms;
  std::uint64_t late_states = 0;
  for (int i = 0; i < settings.rounds; ++i) {
    std::fprintf(stderr, "\rkilled HRTC %d of %d ", i + 1, settings.rounds);
    const std::uint64_t before = session.observed().roster.at(session::id_of("right")).origin.incarnation;
    const std::size_t printed = left->output().size();
    const std::int64_t killed_ns = realtime::monotonic_ns();
    right->signal_all(SIGKILL);
    session.forget_states();
    const std::int64_t gone_ns = wait_for_text(*left, printed, "HRTC 'right' is silent", 5s);
    gone_ms.add(gone_ns == 0 ? kUnfinished : static_cast<double>(gone_ns - killed_ns) * 1e-6);
    const std::int64_t started_ns = realtime::monotonic_ns();
    right = touched.start_hrtc(Side::kB, "right", {"bob"});
    session.wait_until("the HRTC that was started again",
                       [&](const ObservedSession& observed) { return observed.touches_exactly("bob", before); });
    ready_ms.add(ms_since(started_ns));
    bool has_new = false;
    for (const ObservedSession::State& state : session.observed().states) {
      if (state.user != session::id_of("bob")) continue;
      has_new = has_new || state.incarnation != before;
      if (has_new && state.incarnation == before) ++late_states;
    }
    pause(500ms);
  }
  const Population kills{"kills", gone_ms.size()};
  report.add_percentiles("time until a peer has removed the killed HRTC", "kills", "ms", gone_ms);
  report.add_percentiles("time from the start until the user touches exactly", "kills", "ms", ready_ms);
  report.add_at_most("max time until a peer has removed the killed HRTC", kills, "ms", gone_ms.max(), 500);
  report.add_at_most("max time from the start until the user touches exactly", kills, "ms", ready_ms.max(), 2000);
  report.add_at_most("states of the killed process after those of the next", kills, "",
                     static_cast<double>(late_states), 0);
}

void measure_flood(const FaultSettings& settings, Report& report) {
  TouchedSession touched;
  LiveSession& session = touched.session();
  touched.start_host(Side::kB);
  const auto desk =
      touched.start_hrtc(Side::kB, "desk", {"ann", "bob"},
                         {"--no-coding", "--flight-recorder", "3600", "--flight-file", touched.path("flight.mcap")});
  touched.wait_for_touch("ann");
  touched.wait_for_touch("bob");
  pause(2s);
  const pid_t gateway = desk->child("tactus-gateway");
  const double before_mb = resident_mb(gateway);
  std::vector<Window> quiet, flooded;
  std::uint64_t sent = 0;
  double flooded_s = 0;
  std::size_t min_states = ~std::size_t{0};
  for (int i = 0; i < settings.rounds; ++i) {
    std::fprintf(stderr, "\rflood %d of %d ", i + 1, settings.rounds);
    const std::int64_t begin_ns = realtime::monotonic_ns();
    pause(2s);
    const std::int64_t middle_ns = realtime::monotonic_ns();
    quiet.push_back({begin_ns, middle_ns});
    session.forget_states();
    {
      const Flood flood{session.pair(), Side::kA, session.address("").domain, settings.seed + static_cast<unsigned>(i)};
      pause(2s);
      sent += flood.sent();
    }
    flooded.push_back({middle_ns, realtime::monotonic_ns()});
    flooded_s += ms_since(middle_ns) * 1e-3;
    min_states = std::min(min_states, session.observed().states.size());
  }
  const double growth_mb = resident_mb(gateway) - before_mb;
  touched.wait_for_touch("ann");
  desk->signal(SIGTERM);
  if (desk->wait(60s) != 0) throw std::runtime_error{"the HRTC failed:\n" + desk->output()};
  const Cycles cycles = read_cycles(touched.path("flight.mcap"));
  CycleFigures in_quiet, in_flood;
  for (const Window& window : quiet) in_quiet.add(cycles, window);
  for (const Window& window : flooded) in_flood.add(cycles, window);
  const Population windows{"windows of 2 s", flooded.size()}, all{"cycles", in_flood.intervals_ms.size()};
  report.add_at_least("packets sent", windows, "1/s", static_cast<double>(sent) / flooded_s, 9000);
  report.add_percentiles("time between two cycles, without the flood", "cycles", "ms", in_quiet.intervals_ms);
  report.add_percentiles("time between two cycles, flood", "cycles", "ms", in_flood.intervals_ms);
  report.add_at_most("p99 of the time between two cycles, flood divided by without", all, "times",
                     in_flood.intervals_ms.percentile(0.99) / in_quiet.intervals_ms.percentile(0.99), 1.1);
  report.add_at_most("largest change of a force, flood", all, "N", in_flood.force_change, 0);
  report.add_at_least("smallest force, flood", all, "N", in_flood.min_force, 0.05);
  report.add_at_least("min number of states that arrive in a window", windows, "", static_cast<double>(min_states),
                      0.9 * 2 * 2000);
  report.add_at_most("growth of the gateway's memory", windows, "MB", growth_mb, 10);
}

void measure_wrong_clock(const FaultSettings& settings, Report& report) {
  for (const WrongClock clock : {WrongClock::kAhead, WrongClock::kBehind}) measure_clock(settings, clock, report);
}

void measure_full_disk(const FaultSettings&, Report& report) {
  TouchedSession touched;
  LiveSession& session = touched.session();
  touched.start_host(Side::kA);
  const auto desk = touched.start_hrtc(Side::kB, "desk", {"ann", "bob"}, {"--no-coding"});
  touched.wait_for_touch("ann");
  const SmallDisk disk{touched.path("disk")};
  const std::string file = disk.folder() / "all.mcap";
  const auto recorder = session.start(Side::kB, "record", {file});
  const auto status = recorder->wait(60s);
  std::uint64_t readable = 0;
  trace::McapReader reader{file};
  for (trace::McapMessage message; reader.next(message);) ++readable;
  session.forget_states();
  pause(1s);
  const Population run{"run", 1};
  report.add_at_most("exit status of the recorder minus 1, absolute", run, "", std::abs(status.value_or(127) - 1), 0);
  report.add_at_most("errors that the recorder prints, minus 1, absolute", run, "",
                     std::abs(static_cast<double>(count_of(recorder->output(), "cannot write")) - 1), 0);
  report.add_at_least("messages that can be read from the file", run, "", static_cast<double>(readable), 1000);
  report.add_at_least("states of the session in the second after it", run, "",
                      static_cast<double>(session.observed().states.size()), 1800);
}

void measure_body_takeover(const FaultSettings& settings, Report& report) {
  test_support::TemporaryFolder folder;
  const std::string model = folder.path() / "crate.spm";
  run_program("mesh", {"generate", "box", "--faces", "1200", folder.path() / "crate.ply"});
  run_program("mesh", {"build", folder.path() / "crate.ply", model, "--size", "0.12"});
  // The crate falls to the ground, so its pose is not that of the catalogue.
  std::ofstream{folder.path() / "store.yaml"} << "objects:\n  - name: crate\n    model: crate.spm\n"
                                                 "    position: [0, 0, 0.1]\n    body: {mass: 0.8, friction: 0.6}\n";
  LiveSession session{"veth"};
  const auto start = [&](const std::string& name) {
    auto host = session.start(Side::kA, "host", {"--name", name, "--config", folder.path() / "store.yaml"});
    if (!host->wait_for_line("serving 'crate'"))
      throw std::runtime_error("the host does not serve:\n" + host->output());
    return host;
  };
  PoseObserver poses{session.address("poses")};
  std::string first = "east", second = "west";
  auto first_host = start(first);
  pause(1s);
  auto second_host = start(second);
  Samples silent_ms;
  double max_jump_mm = 0, fallen_mm = 0;
  for (int i = 0; i < settings.rounds; ++i) {
    std::fprintf(stderr, "\rkilled authority %d of %d ", i + 1, settings.rounds);
    pause(2s);
    poses.forget();
    pause(500ms);
    const std::vector<PoseObserver::Arrived> before = poses.arrived();
    if (before.empty()) throw std::runtime_error("no host publishes the pose of the object");
    if (i == 0) fallen_mm = 100 - 1e3 * before.back().pose.pose.position[2];
    poses.forget();
    const std::int64_t killed_ns = realtime::monotonic_ns();
    first_host->signal_all(SIGKILL);
    std::optional<PoseObserver::Arrived> after;
    while (!(after = poses.first_from(second)) && ms_since(killed_ns) < 5000) pause(1ms);
    silent_ms.add(after ? static_cast<double>(after->at_ns - killed_ns) * 1e-6 : kUnfinished);
    if (after) {
      const std::array<double, 3>&a = before.back().pose.pose.position, &b = after->pose.pose.position;
      max_jump_mm = std::max(max_jump_mm, 1e3 * std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]));
    }
    first_host = std::move(second_host);
    std::swap(first, second);
    second_host = start(second);
  }
  const Population kills{"kills", silent_ms.size()};
  report.add_percentiles("time from SIGKILL until the other host publishes poses", "kills", "ms", silent_ms);
  report.add_at_most("max time from SIGKILL until the other host publishes poses", kills, "ms", silent_ms.max(), 300);
  report.add_at_most("largest jump of the object", kills, "mm", max_jump_mm, 0.1);
  report.add_at_least("fall of the object before the first kill", {"object", 1}, "mm", fallen_mm, 30);
}

namespace {

/// A run of `tactus chaos`.
struct Injection {
  std::string name;                ///< begins the names of its rows
  std::vector<std::string> kinds;  ///< of faults
  double seconds;
  bool kills_services = false;  ///< also hosts and HRTCs, which it starts again
};

/// Runs `tactus chaos`, and adds its results to the report. Meanwhile checks the cycles of an HRTC if there is a `log`.
void inject(TouchedSession& touched, const Injection& injection, std::uint64_t seed, CycleLog* log, Report& report) {
  const std::string results = touched.path("chaos.json"), &what = injection.name;
  std::vector<std::string> arguments{
      "--seconds", std::to_string(injection.seconds), "--seed", std::to_string(seed), "--json", results};
  for (const std::string& kind : injection.kinds) arguments.insert(arguments.end(), {"--only", kind});
  if (injection.kills_services) arguments.emplace_back("--restart");
  const auto chaos = touched.session().start(Side::kB, "chaos", std::move(arguments));
  const std::int64_t begin_ns = realtime::monotonic_ns();
  std::optional<int> status;
  while (!(status = chaos->wait(1s)) && ms_since(begin_ns) < 1e3 * (injection.seconds + 120)) {
    if (log != nullptr) log->poll();
  }
  std::fprintf(stderr, "%s", chaos->output().c_str());
  if (!status || *status > 1) throw std::runtime_error("tactus chaos failed");
  std::ifstream file{results};
  const nlohmann::json json = nlohmann::json::parse(file);
  std::size_t faults = 0;
  for (const nlohmann::json& kind : json.at("faults")) {
    const auto times = kind.at("times").get<std::size_t>();
    faults += times;
    report.add_value(what + "time until the session is complete, max, " + kind.at("kind").get<std::string>(),
                     {"faults", times}, "s", kind.at("max_s").is_null() ? kUnfinished : kind.at("max_s").get<double>());
  }
  const Population all{"faults", faults};
  report.add_at_least(what + "number of faults", all, "", static_cast<double>(faults), injection.seconds / 10);
  report.add_at_most(what + "faults from which the session did not recover", all, "",
                     json.at("unrecovered").get<double>(), 0);
  report.add_at_most(what + "violations", {"probe states", json.at("states").get<std::size_t>()}, "",
                     static_cast<double>(json.at("violations").size()), 0);
  if (injection.kills_services) return;  // a program that has just started still grows
  for (const nlohmann::json& program : json.at("programs")) {
    const std::string label = program.at("label").get<std::string>();
    report.add_at_most(what + "growth of the memory of " + label, {"run", 1}, "MB",
                       program.at("growth_mb").get<double>(), 1);
    report.add_at_most(what + "more file descriptors of " + label, {"run", 1}, "",
                       program.at("descriptors_growth").get<double>(), 0);
  }
}

/// Ends the programs of a session that `tactus chaos` has started.
void end_programs(const LiveSession& session) {
  const wire::SessionAddress address = session.address("observer");
  const auto programs = [&] { return chaos::programs_of(address.session, address.domain, false); };
  const std::int64_t begin_ns = realtime::monotonic_ns();
  for (const chaos::Program& program : programs()) ::kill(program.pid, SIGTERM);
  while (!programs().empty() && ms_since(begin_ns) < 20e3) std::this_thread::sleep_for(50ms);  // they notify nobody
  for (const chaos::Program& program : programs()) ::kill(program.pid, SIGKILL);
}

}  // namespace

void measure_random_faults(const FaultSettings& settings, Report& report) {
  TouchedSession touched{20'000, "veth", Protection::kSecured};
  touched.start_host(Side::kB);
  const std::string flight = touched.path("flight.mcap");
  // The size of a recording depends on what happens in its time, so a longer one would hide a growth of the memory.
  const auto start_hrtc = [&] {
    auto hrtc = touched.start_hrtc(Side::kB, "desk", {"ann", "bob"},
                                   {"--no-coding", "--flight-recorder", std::to_string(CycleLog::kStored),
                                    "--flight-file", flight, "--flight-folder", touched.path("flights")});
    touched.wait_for_touch("ann");
    touched.wait_for_touch("bob");
    return hrtc;
  };
  const auto desk = start_hrtc();
  pause(std::chrono::seconds{CycleLog::kStored + 2});
  CycleLog log{*desk};
  inject(touched, {"", {"suspend", "kill", "loss", "cut"}, settings.seconds / 2}, settings.seed, &log, report);
  // The gateway is not killed here, so its memory can be measured.
  inject(touched, {"without kills: ", {"suspend", "loss", "cut"}, settings.seconds / 4}, settings.seed, &log, report);
  touched.wait_for_touch("ann");
  log.poll();
  desk->signal(SIGTERM);
  if (desk->wait(60s) != 0) throw std::runtime_error{"the HRTC failed:\n" + desk->output()};
  ForceChecker& checker = log.checker();
  checker.check(flight);
  for (const std::string& text : checker.texts()) report.add_note(text);
  const Population cycles{"cycles", checker.cycles()};
  report.add_at_most("cycles that are in no flight recording", cycles, "", static_cast<double>(checker.missing()), 0);
  report.add_at_most("forces and cycles that break a rule", cycles, "", static_cast<double>(checker.violations()), 0);
  report.add_value("largest force of a cycle", cycles, "N", checker.max_force());
  report.add_value("largest change of a force in a cycle", cycles, "N", checker.max_step());
  // The replay computes every cycle of the recording again, and finds out whether all forces are the same.
  Process replay{{program_path("replay"), flight, "--model", touched.path("organ.spm")}};
  report.add_at_most("exit status of the replay of the last cycles", {"recording", 1}, "",
                     replay.wait(300s).value_or(127), 0);

  const auto second_desk = start_hrtc();
  const std::unique_ptr<LiveSession, void (*)(LiveSession*)> started{
      &touched.session(), [](LiveSession* session) { end_programs(*session); }};
  const Injection kills{"with kills of hosts and HRTCs: ", {"suspend", "kill"}, settings.seconds / 4, true};
  inject(touched, kills, settings.seed, nullptr, report);
  touched.wait_for_touch("ann");
  touched.wait_for_touch("bob");
}

}  // namespace tactus::bench
