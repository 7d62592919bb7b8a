// The effect of many HRTCs on a host and on each other: tactus-host and tactus-hrtc as a user starts them.
//
//   trouble   one HRTC is frozen, or gets a tenth of its time: the delay of the others' records and probe states, with
//             all programs at ordinary priority, and with all but that HRTC at real-time priority
//   joining   32 HRTCs start within a second, their tips resting at as many places: when the last touches exactly;
//             also fewer HRTCs, and moving tips
//   coded     64 probes at 1 kHz, 8 to an HRTC, each on a path of its own: the deadband-coded states that HRTCs count
//   as sent,
//             those that a listener receives, and the cost; also fewer probes
//   crowding  8 HRTCs follow one path: the bytes that the host sends, over those for one HRTC
//   state     32 HRTCs, 10,000 regions: the heap that a host's half of delivery takes for them
#include <malloc.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "bench/fetcher.hpp"
#include "bench/latency_bench.hpp"
#include "bench/models.hpp"
#include "bench/surface_path.hpp"
#include "session/delivery_server.hpp"
#include "session/figures.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/fcl/fixed_mesh.hpp"
#include "spm/offline/model_file.hpp"
#include "tests/support/process.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

using e2e::Process;
using spm::Vec3d;
using std::chrono::milliseconds;

constexpr double kPeriod = 0.001;  // s
constexpr double kRadius = 0.003;  // m
constexpr double kDepth = 0.0003;  // m
constexpr double kSpeed = 0.05;    // m/s
constexpr double kFast = 0.3;      // m/s, of those that load the host
constexpr std::int64_t kSecond = 1'000'000'000;

struct Settings {
  std::string part;
  std::uint32_t faces = 1'000'000;
  int domain = 40;
  int pairs = 10;
  double seconds = 2;  // of each window
  int joining = 32;
  int fewest = 0;                           // joining together; 0: an eighth of joining
  int probes = 64;                          // with deadband-coded states, 8 to an HRTC
  std::uint32_t regions_faces = 2'950'000;  // of a model of some 10,000 regions
};

/// CPU time of a running process, s; 0 after its end.
double cpu_seconds(int pid) {
  std::ifstream file{"/proc/" + std::to_string(pid) + "/stat"};
  std::string text;
  std::getline(file, text);
  const std::size_t name_end = text.rfind(')');
  if (name_end == std::string::npos) return 0;
  std::istringstream fields{text.substr(name_end + 2)};
  std::string skipped;
  for (int i = 0; i < 11; ++i) fields >> skipped;
  double user = 0, system = 0;
  fields >> user >> system;
  return (user + system) / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

/// Coded probe states of all users.
struct Received {
  Samples ages;        // us, from sending to decoding, of all that arrived
  double counted = 0,  // arrived between the first and the last metrics of their HRTC
      sent = 0;        // in the same time, as the HRTCs count
};

/// Receives probe states and metrics of all in the session.
class Watch {
 public:
  explicit Watch(const wire::SessionAddress& address)
      : links_{address},
        states_{links_, wire::topics::kProbeState, [this](session::ProbeState&& state) { take(state); }},
        metrics_{links_, wire::topics::kMetrics, [this](session::Metrics&& metrics) { take(metrics); }} {}

  /// Adds the ages of the probe states of `user` to `ages` from now on; null: stops.
  void follow(const std::string& user, Samples* ages) {
    const std::lock_guard lock{mutex_};
    followed_ = session::id_of(user);
    ages_ = ages;
  }
  /// Counts the states of all users until `received` is called.
  void count_all() {
    const std::lock_guard lock{mutex_};
    counting_ = true;
    received_ = {};
    counts_.clear();
  }
  [[nodiscard]] Received received() {
    const std::lock_guard lock{mutex_};
    counting_ = false;
    for (const auto& [hrtc, count] : counts_) {
      received_.counted += count.arrived_at_last - count.arrived_at_first;
      received_.sent += count.sent_at_last - count.sent_at_first;
    }
    return std::exchange(received_, {});
  }
  /// Users that have touched exactly.
  [[nodiscard]] std::size_t touching() const {
    const std::lock_guard lock{mutex_};
    return touching_.size();
  }
  /// The newest figure of that name of a participant; 0 when none has come.
  [[nodiscard]] double figure(const std::string& participant, const std::string& name) const {
    const std::lock_guard lock{mutex_};
    const auto found = figures_.find({session::id_of(participant), name});
    return found == figures_.end() ? 0 : found->second;
  }

 private:
  /// Of one HRTC, at its first and last metrics while counting.
  struct Count {
    double arrived = 0, arrived_at_first = 0, arrived_at_last = 0, sent_at_first = -1, sent_at_last = 0;
  };

  void take(const session::ProbeState& state) {
    const std::lock_guard lock{mutex_};
    const double age_us = static_cast<double>(wire::monotonic_ns() - state.origin.time_ns) / 1e3;
    if (ages_ != nullptr && state.user_id == followed_) ages_->add(age_us);
    if (counting_) {
      received_.ages.add(age_us);
      ++counts_[state.origin.participant].arrived;
    }
    constexpr std::uint32_t kTouches = session::kInContact | session::kExact;
    if ((state.status & kTouches) == kTouches) touching_.insert(state.user_id);
  }
  void take(const session::Metrics& metrics) {
    const std::lock_guard lock{mutex_};
    for (const auto& [name, value] : metrics.figures) {
      figures_[{metrics.origin.participant, name}] = value;
      if (!counting_ || name != session::figures::kStatesDeadbandCoded) continue;
      Count& count = counts_[metrics.origin.participant];
      if (count.sent_at_first < 0) {
        count.sent_at_first = value;
        count.arrived_at_first = count.arrived;
      }
      count.sent_at_last = value;
      count.arrived_at_last = count.arrived;
    }
  }

  mutable std::mutex mutex_;
  std::uint64_t followed_ = 0;
  Samples* ages_ = nullptr;
  bool counting_ = false;
  Received received_;
  std::map<std::uint64_t, Count> counts_;  // by HRTC
  std::set<std::uint64_t> touching_;
  std::map<std::pair<std::uint64_t, std::string>, double> figures_;
  wire::Participants links_;
  wire::Reader<session::ProbeState> states_;
  wire::Reader<session::Metrics> metrics_;
};

/// A model, two paths on it, and programs around them in sessions of their own.
class Laboratory {
 public:
  explicit Laboratory(const Settings& settings) : settings_{settings} {
    std::fprintf(stderr, "making the model and paths\n");
    LoadedModel subject = load_model({}, settings.faces);
    digest_ = subject.model.summary.digest;
    spm::offline::write_model(folder_.path() / "model.spm", subject.model, {});
    scale_to_edge(subject, kHandEdge);
    std::ofstream config{folder_.path() / "host.yaml"};
    config.precision(17);
    config << "objects:\n  - name: object\n    model: " << (folder_.path() / "model.spm").string()
           << "\n    position: [0, 0, 0]\n    scale: " << subject.model.summary.metres_per_unit << '\n';
    if (!config.flush()) throw std::runtime_error("cannot write " + (folder_.path() / "host.yaml").string());
    record("slow.csv", subject, kSpeed);
    if (settings.part.empty() || settings.part == "coded")
      for (int place = 0; place < settings.probes; ++place) wander(place);
    record("fast.csv", subject, kFast);
    for (int place = 0; place < settings.joining; ++place) rest(place);
    programs_ = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  }

  [[nodiscard]] std::uint64_t digest() const noexcept { return digest_; }

  /// Serving, in `session`.
  [[nodiscard]] std::unique_ptr<Process> host(const std::string& session) const {
    auto host = start("tactus-host", session, {"--name", "host", "--config", (folder_.path() / "host.yaml").string()});
    if (!host->wait_for_line("serving 'object'", std::chrono::seconds{60}))
      throw std::runtime_error("the host does not serve:\n" + host->output());
    return host;
  }
  /// An HRTC with a user of the same name that follows a recording, "slow" or "fast".
  [[nodiscard]] std::unique_ptr<Process> hrtc(const std::string& session, const std::string& name,
                                              const std::string& path, std::vector<std::string> more = {}) const {
    more.insert(more.end(), {"--name", name, "--replay", name + "=" + (folder_.path() / (path + ".csv")).string()});
    return start("tactus-hrtc", session, more);
  }
  /// An HRTC with users that follow the given recordings; their names contain those of HRTC and recording.
  [[nodiscard]] std::unique_ptr<Process> hrtc(const std::string& session, const std::string& name,
                                              const std::vector<std::string>& paths) const {
    std::vector<std::string> arguments{"--name", name};
    for (const std::string& path : paths)
      arguments.insert(arguments.end(),
                       {"--replay", name + "-" + path + "=" + (folder_.path() / (path + ".csv")).string()});
    return start("tactus-hrtc", session, arguments);
  }
  /// The recording of a tip that moves from a place on.
  [[nodiscard]] static std::string wandering(int place) { return "path-" + std::to_string(place); }
  /// The recording of a tip that stays at a place.
  [[nodiscard]] static std::string resting(int place) { return "rest-" + std::to_string(place); }
  [[nodiscard]] wire::SessionAddress address(const std::string& session, const std::string& participant) const {
    wire::SessionAddress address;
    address.session = session;
    address.participant = participant;
    address.domain = settings_.domain;
    address.qos = wire::default_qos_directory();
    return address;
  }

 private:
  [[nodiscard]] std::unique_ptr<Process> start(const std::string& program, const std::string& session,
                                               const std::vector<std::string>& more) const {
    std::vector<std::string> command{(programs_ / program).string(), "--session", session, "--domain",
                                     std::to_string(settings_.domain)};
    command.insert(command.end(), more.begin(), more.end());
    return std::make_unique<Process>(std::move(command));
  }
  void record(const std::string& name, const LoadedModel& subject, double speed) {
    const double unit = subject.model.summary.metres_per_unit;
    const spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
    const PathSettings path{kRadius / unit, kDepth / unit, speed * kPeriod / unit, 30'000, 1};
    std::ofstream out{folder_.path() / name};
    out.precision(9);
    double time = 0;
    path_.clear();
    for (const Vec3d& at : surface_path(subject.model.positions, subject.finest, path,
                                        [&](const Vec3d& p) { return finest.distance(p); })) {
      path_.push_back(at * unit);
      write_row(out, time, path_.back());
      time += kPeriod;
    }
    if (!out.flush()) throw std::runtime_error("cannot write " + name);
  }
  /// A tip that stays at a place on the path recorded last; the places of all HRTCs are evenly spaced.
  void rest(int place) const {
    const std::string name = resting(place) + ".csv";
    std::ofstream out{folder_.path() / name};
    out.precision(9);
    const std::size_t at = path_.size() * static_cast<std::size_t>(place) / static_cast<std::size_t>(settings_.joining);
    for (const double time : {0.0, 60.0}) write_row(out, time, path_[at]);
    if (!out.flush()) throw std::runtime_error("cannot write " + name);
  }
  /// A tip that follows the path recorded last from a place of its own.
  void wander(int place) const {
    const std::string name = wandering(place) + ".csv";
    std::ofstream out{folder_.path() / name};
    out.precision(9);
    constexpr std::size_t kSteps = 20'000, kStride = 5;
    const std::size_t steps = std::min(kSteps, path_.size());
    const std::size_t from =
        (path_.size() - steps) * static_cast<std::size_t>(place) / static_cast<std::size_t>(settings_.probes);
    for (std::size_t i = 0; i < steps; i += kStride) write_row(out, static_cast<double>(i) * kPeriod, path_[from + i]);
    if (!out.flush()) throw std::runtime_error("cannot write " + name);
  }
  static void write_row(std::ofstream& out, double time, const Vec3d& at) {
    out << time << ',' << at[0] << ',' << at[1] << ',' << at[2] << '\n';
  }

  Settings settings_;
  std::uint64_t digest_ = 0;
  std::vector<Vec3d> path_;  // recorded last
  test_support::TemporaryFolder folder_;
  std::filesystem::path programs_;
};

void end(Process& program) {
  program.signal(SIGTERM);
  (void)program.wait();
}

/// Waits for `done`, which it tests every 5 ms; false when `limit` passes first.
template <class Done>
bool wait_until(std::int64_t limit_ns, Done&& done) {
  for (const std::int64_t until = wire::monotonic_ns() + limit_ns; !done();
       std::this_thread::sleep_for(milliseconds{5}))
    if (wire::monotonic_ns() > until || wire::stop_signal()) return false;
  return true;
}

// ---- trouble

/// SCHED_RR for this thread and for the programs and threads that it starts, where the system allows it. Then other
/// ordinary work does not decide a window's p99, which is the third worst of some 260 regions.
class AboveOrdinary {
 public:
  AboveOrdinary() {
    const sched_param lowest{1};
    allowed_ = pthread_setschedparam(pthread_self(), SCHED_RR, &lowest) == 0;
  }
  ~AboveOrdinary() {
    const sched_param none{0};
    if (allowed_) pthread_setschedparam(pthread_self(), SCHED_OTHER, &none);
  }
  AboveOrdinary(const AboveOrdinary&) = delete;
  AboveOrdinary& operator=(const AboveOrdinary&) = delete;
  [[nodiscard]] bool allowed() const noexcept { return allowed_; }

 private:
  bool allowed_;
};

enum class Trouble { kNone, kFrozen, kSlow };
enum class Others { kOrdinary, kRealTime };  // priority of all but the HRTC in trouble

struct TroubleRuns {
  Samples records_p99, age_p99;  // of each window, ms and us
};

/// Lets a process run for a tenth of the time.
class Throttle {
 public:
  explicit Throttle(Process& program)
      : thread_{[this, &program] {
          while (!done_) {
            program.signal(SIGSTOP);
            std::this_thread::sleep_for(milliseconds{90});  // a tenth of the time is left to it
            program.signal(SIGCONT);
            std::this_thread::sleep_for(milliseconds{10});
          }
        }} {}
  ~Throttle() {
    done_ = true;
    thread_.join();
  }

 private:
  std::atomic<bool> done_{false};
  std::thread thread_;
};

std::array<TroubleRuns, 3> run_trouble(const Laboratory& lab, const Settings& settings, Others others) {
  const std::string session = others == Others::kOrdinary ? "trouble" : "trouble-rt";
  // Always ordinary: it stands for an HRTC on another machine, whose bursts take no time from the others.
  const std::vector<std::string> ordinary{"--priority", "0"};
  const auto other = lab.hrtc(session, "other", "fast", ordinary);
  std::optional<AboveOrdinary> above;
  if (others == Others::kRealTime && !above.emplace().allowed())
    std::fprintf(stderr, "trouble: no right to SCHED_RR, so that other work counts as well\n");
  const auto host = lab.host(session);
  const auto calm =
      lab.hrtc(session, "calm", "slow", others == Others::kOrdinary ? ordinary : std::vector<std::string>{});
  Watch watch{lab.address(session, "watch")};
  Fetcher fetcher{lab.address(session, "fetcher")};
  const auto go_on = [&](double seconds, Samples* times) {
    fetcher.run(wire::monotonic_ns() + static_cast<std::int64_t>(seconds * 1e9), times);
  };
  for (int tries = 0; !(fetcher.ready() && watch.touching() >= 2); ++tries) {
    if (tries > 100) throw std::runtime_error("the HRTCs do not touch:\n" + calm->output() + other->output());
    go_on(0.1, nullptr);
  }
  std::array<TroubleRuns, 3> runs;
  for (int pair = 0; pair < settings.pairs && !wire::stop_signal(); ++pair) {
    std::fprintf(stderr, "trouble: %d of %d\n", pair + 1, settings.pairs);
    for (const Trouble trouble : {Trouble::kNone, Trouble::kFrozen, Trouble::kSlow}) {
      go_on(1, nullptr);  // until all are back
      Samples times, ages;
      watch.follow("calm", &ages);
      {
        std::optional<Throttle> throttle;
        if (trouble == Trouble::kFrozen) other->signal(SIGSTOP);
        if (trouble == Trouble::kSlow) throttle.emplace(*other);
        go_on(settings.seconds, &times);
      }
      watch.follow("calm", nullptr);
      other->signal(SIGCONT);
      TroubleRuns& run = runs[static_cast<std::size_t>(trouble)];
      run.records_p99.add(times.percentile(0.99));
      run.age_p99.add(ages.percentile(0.99));
    }
  }
  for (const auto& program : {host.get(), calm.get(), other.get()}) end(*program);
  return runs;
}

// ---- joining

struct Joining {
  double started = 0, ready = 0, cpu = 0;  // s
  double cores = 0;                        // that host and HRTCs take, once all touch
  std::size_t touching = 0;
};

enum class Tips { kRest, kMove };

Joining run_joining(const Laboratory& lab, int many, Tips tips) {
  std::fprintf(stderr, "joining: %d HRTCs\n", many);
  const std::string session = "joining";
  const auto host = lab.host(session);
  Watch watch{lab.address(session, "watch")};
  std::vector<std::unique_ptr<Process>> hrtcs;
  const std::int64_t began = wire::monotonic_ns();
  for (int i = 0; i < many; ++i)
    hrtcs.push_back(
        lab.hrtc(session, "hrtc-" + std::to_string(i), tips == Tips::kMove ? "slow" : Laboratory::resting(i),
                 {"--priority", "0", "--users", "1", "--pool", "16384", "--rate", "100", "--state-rate", "20"}));
  Joining joining;
  joining.started = static_cast<double>(wire::monotonic_ns() - began) / 1e9;
  (void)wait_until(20 * kSecond, [&] { return watch.touching() >= hrtcs.size(); });
  joining.ready = static_cast<double>(wire::monotonic_ns() - began) / 1e9;
  joining.touching = watch.touching();
  const auto cpu_of_all = [&] {
    double sum = cpu_seconds(host->pid());
    for (const auto& hrtc : hrtcs) sum += cpu_seconds(hrtc->pid());
    return sum;
  };
  joining.cpu = cpu_of_all();
  constexpr int kSteady = 2;  // s
  std::this_thread::sleep_for(std::chrono::seconds{kSteady});
  joining.cores = (cpu_of_all() - joining.cpu) / kSteady;
  for (const auto& hrtc : hrtcs) hrtc->signal(SIGTERM);
  for (const auto& hrtc : hrtcs) (void)hrtc->wait();
  end(*host);
  return joining;
}

// ---- coded

struct Coded {
  Received received;
  double seconds = 0;
  double touching = 0;  // probes that have touched exactly
  double cores = 0;     // that host and HRTCs take
  double cycles = 0;    // of all HRTCs, and of these
  double overruns = 0, preempted = 0, unknown = 0, skipped = 0;
};

Coded run_coded(const Laboratory& lab, const Settings& settings, int probes) {
  constexpr int kEach = 8;  // what an HRTC takes at most
  std::fprintf(stderr, "coded: %d probes\n", probes);
  const std::string session = "coded-" + std::to_string(probes);
  const auto host = lab.host(session);
  Watch watch{lab.address(session, "watch")};
  std::vector<std::unique_ptr<Process>> hrtcs;
  std::vector<std::string> names;
  for (int first = 0; first < probes; first += kEach) {
    std::vector<std::string> paths;
    for (int place = first; place < std::min(first + kEach, probes); ++place)
      paths.push_back(Laboratory::wandering(place * settings.probes / probes));
    names.push_back("hrtc-" + std::to_string(names.size()));
    hrtcs.push_back(lab.hrtc(session, names.back(), paths));
  }
  (void)wait_until(10 * kSecond, [&] { return watch.touching() >= static_cast<std::size_t>(probes); });
  std::this_thread::sleep_for(std::chrono::seconds{1});  // the end of joining is not measured
  Coded coded;
  coded.touching = static_cast<double>(watch.touching());
  const auto of_all = [&](const char* figure) {
    double sum = 0;
    for (const std::string& name : names) sum += watch.figure(name, figure);
    return sum;
  };
  const auto take = [&](double sign) {
    coded.cores += sign * cpu_seconds(host->pid());
    for (const auto& hrtc : hrtcs) coded.cores += sign * cpu_seconds(hrtc->pid());
    coded.seconds += sign * static_cast<double>(wire::monotonic_ns()) / 1e9;
    coded.cycles += sign * of_all(session::figures::kCycles);
    coded.overruns += sign * of_all(session::figures::kOverruns);
    coded.preempted += sign * of_all(session::figures::kPreempted);
    coded.unknown += sign * of_all(session::figures::kLateUnknown);
    coded.skipped += sign * of_all(session::figures::kSkipped);
  };
  take(-1);
  watch.count_all();
  constexpr double kMinSeconds = 10;  // an HRTC counts what it sent once a second, a few ms before or after us
  std::this_thread::sleep_for(std::chrono::duration<double>{std::max(settings.seconds, kMinSeconds)});
  coded.received = watch.received();
  take(1);
  coded.cores /= coded.seconds;
  for (const auto& hrtc : hrtcs) hrtc->signal(SIGTERM);
  for (const auto& hrtc : hrtcs) (void)hrtc->wait();
  end(*host);
  return coded;
}

// ---- crowding

/// Bytes that a host sends to so many HRTCs on one path.
double run_crowd(const Laboratory& lab, int hrtcs) {
  std::fprintf(stderr, "crowding: %d HRTCs\n", hrtcs);
  const std::string session = "crowd-" + std::to_string(hrtcs);
  const auto host = lab.host(session);
  Watch watch{lab.address(session, "watch")};
  std::vector<std::unique_ptr<Process>> crowd;
  for (int i = 0; i < hrtcs; ++i)
    crowd.push_back(lab.hrtc(session, "hrtc-" + std::to_string(i), "slow", {"--users", "1", "--state-rate", "50"}));
  (void)wait_until(20 * kSecond, [&] { return watch.touching() >= crowd.size(); });
  std::this_thread::sleep_for(std::chrono::seconds{6});  // the bytes of this time are compared
  const double bytes = watch.figure("host", session::figures::kHostBytes);
  for (const auto& hrtc : crowd) end(*hrtc);
  end(*host);
  return bytes;
}

// ---- state

struct State {
  std::uint32_t regions = 0;
  double bytes = 0;
};

/// Each HRTC holds a thousand intervals of regions, wants more and gets some of them.
State run_state(const Settings& settings) {
  std::fprintf(stderr, "state: 32 HRTCs\n");
  constexpr std::uint64_t kSession = 1, kObject = 2, kHost = 3;
  const LoadedModel subject = load_model({}, settings.regions_faces);
  const spm::codec::EncodedModel encoded{subject.model};
  const session::Origin host{kSession, kHost, 1, 0};
  session::DeliveryServer server{host};
  server.add(kObject, encoded.coded());
  const std::uint32_t regions = subject.model.summary.regions;
  const auto before = static_cast<double>(mallinfo2().uordblks);
  for (std::uint64_t hrtc = 100; hrtc < 132; ++hrtc) {
    session::Demand demand;
    demand.origin = {kSession, hrtc, 1, 0};
    demand.object_id = kObject;
    demand.digest = subject.model.summary.digest;
    demand.serving_host = kHost;
    demand.epoch = 1;
    demand.stream = session::stream_id(host, demand.origin, kObject);
    demand.credit = 1 << 20;
    // An HRTC holds a quarter of each stretch, and wants the first region of some.
    const std::uint32_t runs = std::min<std::uint32_t>(session::kMaxHaveIntervals, regions / 4);
    const std::uint32_t stretch = regions / runs;
    for (std::uint32_t run = 0; run < runs; ++run) demand.have.push_back({run * stretch + stretch / 2, stretch / 4});
    for (std::uint32_t run = hrtc % 4; run < runs && demand.wanted.size() < session::kMaxWanted; run += 4)
      demand.wanted.push_back({run * stretch, run * 1000});
    if (server.on_demand(demand, 0) != session::DeliveryServer::DemandResult::kTaken)
      throw std::runtime_error("the server does not take a demand");
  }
  for (int chunk = 0; chunk < 3200; ++chunk) (void)server.next(chunk * INT64_C(100'000));
  return {regions, static_cast<double>(mallinfo2().uordblks) - before};
}

void report_trouble(const Laboratory& lab, const Settings& settings, Report& report) {
  const std::array<const char*, 3> names{"all run", "one frozen", "one has a tenth of its time"};
  for (const Others others : {Others::kOrdinary, Others::kRealTime}) {
    const std::array<TroubleRuns, 3> trouble = run_trouble(lab, settings, others);
    const std::string priority = others == Others::kOrdinary ? ", ordinary priority" : ", others at real-time priority";
    for (std::size_t i = 0; i < 3; ++i) {
      report.row("a region's records, p99", names[i] + priority + ", windows", "ms", trouble[i].records_p99);
      report.row("probe states, age p99", names[i] + priority + ", windows", "us", trouble[i].age_p99);
      if (i == 0) continue;
      report.at_most("a region's records, p99, over that when all run",
                     {names[i] + priority + ", windows", trouble[i].age_p99.size()}, "times",
                     trouble[i].records_p99.percentile(0.5) / trouble[0].records_p99.percentile(0.5), 1.1);
      report.at_most("probe states, age p99, over that when all run",
                     {names[i] + priority + ", windows", trouble[i].age_p99.size()}, "times",
                     trouble[i].age_p99.percentile(0.5) / trouble[0].age_p99.percentile(0.5), 1.1);
    }
  }
}

void report_joining(const Laboratory& lab, const Settings& settings, Report& report) {
  for (const Tips tips : {Tips::kRest, Tips::kMove}) {
    const int max = tips == Tips::kRest ? settings.joining : settings.joining / 2;
    const int fewest = settings.fewest > 0 ? settings.fewest : std::max(settings.joining / 8, 1);
    for (int many = fewest; many <= max && !wire::stop_signal(); many *= 2) {
      const Joining joining = run_joining(lab, many, tips);
      const std::string who = std::to_string(many) + " HRTCs, tips " + (tips == Tips::kRest ? "resting" : "at 5 cm/s");
      report.figure("all started after", who, "s", joining.started);
      report.figure("CPU time until then, host and HRTCs", who, "s", joining.cpu);
      report.figure("CPU time a second after that", who, "s", joining.cores);
      if (tips == Tips::kRest && many == settings.joining) {
        report.at_least("touch exactly", who, "", static_cast<double>(joining.touching), many);
        report.at_most("the last touches exactly after", who, "s", joining.ready, 5);
      } else {
        report.figure("touch exactly", who, "", static_cast<double>(joining.touching));
        report.figure("the last touches exactly after", who, "s", joining.ready);
      }
    }
  }
}

void report_coded(const Laboratory& lab, const Settings& settings, Report& report) {
  for (int probes = std::max(settings.probes / 8, 1); probes <= settings.probes && !wire::stop_signal(); probes *= 2) {
    const Coded coded = run_coded(lab, settings, probes);
    const std::string who = std::to_string(probes) + " coded probes at 5 cm/s";
    report.row("deadband-coded states, age", who, "us", coded.received.ages);
    report.figure("deadband-coded states a second", "of each of " + who, "",
                  static_cast<double>(coded.received.ages.size()) / coded.seconds / probes);
    report.figure("deadband-coded states sent, as HRTCs count", who, "", coded.received.sent);
    report.figure("deadband-coded states received of these", who, "", coded.received.counted);
    report.figure("cores, host and HRTCs", who, "", coded.cores);
    report.figure("overruns", who, "% of cycles", 100 * coded.overruns / coded.cycles);
    report.figure("late cycles, preempted", who, "% of cycles", 100 * coded.preempted / coded.cycles);
    report.figure("late cycles, unknown", who, "% of cycles", 100 * coded.unknown / coded.cycles);
    report.figure("cycles skipped", who, "%", 100 * coded.skipped / coded.cycles);
    report.figure("touch exactly", who, "", coded.touching);
    const double share = 100 * coded.received.counted / coded.received.sent;
    if (probes == settings.probes) {
      report.at_least("deadband-coded states delivered", who, "%", share, 99.9);
      report.at_least("touch exactly", who, "", coded.touching, probes);
    } else {
      report.figure("deadband-coded states delivered", who, "%", share);
    }
  }
}

void report_crowding(const Laboratory& lab, const Settings&, Report& report) {
  const double one = run_crowd(lab, 1), eight = run_crowd(lab, 8);
  report.figure("bytes of a host for 8 HRTCs on one path", "over those for one", "times", eight / one);
}

void report_state(const Settings& settings, Report& report) {
  const State state = run_state(settings);
  report.figure("regions of the model", "state", "", state.regions);
  report.at_most("heap of a host's half of delivery", "32 HRTCs", "MiB", state.bytes / (1 << 20), 1);
}

Report run(const Settings& settings) {
  const auto wanted = [&](const char* part) { return settings.part.empty() || settings.part == part; };
  const Laboratory lab{settings};
  char text[160];
  std::snprintf(text, sizeof text, "organ of %u faces, %d windows of %g s of each kind, tips at 5 and 30 cm/s",
                settings.faces, settings.pairs, settings.seconds);
  Report report{{"organ", lab.digest(), settings.faces, text}};
  if (wanted("trouble")) report_trouble(lab, settings, report);
  if (wanted("joining")) report_joining(lab, settings, report);
  if (wanted("coded")) report_coded(lab, settings, report);
  if (wanted("crowding")) report_crowding(lab, settings, report);
  if (wanted("state")) report_state(settings, report);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "scale", "Many HRTCs at one host: one in trouble, 32 joining, 64 coded probes, 8 crowding, the host's state",
      "smaller models, 2 windows and 4 HRTCs"};
  app.add_option("--faces", settings.faces, "of the generated organ")->check(CLI::Range(10'000, 10'000'000));
  app.add_option("--pairs", settings.pairs, "windows of each kind")->check(CLI::Range(1, 100));
  app.add_option("--seconds", settings.seconds, "of each window")->check(CLI::Range(0.5, 60.0));
  app.add_option("--joining", settings.joining, "HRTCs that join within a second")->check(CLI::Range(1, 64));
  app.add_option("--fewest", settings.fewest,
                 "HRTCs that join together, doubled until --joining; else an eighth of it");
  app.add_option("--probes", settings.probes, "that are coded, 8 to an HRTC")->check(CLI::Range(1, 64));
  app.add_option("--domain", settings.domain, "first of the three DDS domains used")->check(CLI::Range(1, 95));
  app.add_option("--part", settings.part, "only this one")
      ->check(CLI::IsMember({"trouble", "joining", "coded", "crowding", "state"}));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.faces = settings.regions_faces = 200'000;
      settings.pairs = 2;
      settings.joining = 4;
      settings.probes = 8;
    }
    return tactus::bench::run(settings);
  });
}
