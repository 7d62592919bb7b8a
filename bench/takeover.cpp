// Kills the host that serves a touched object. Measures the time until the HRTC detects this, the time until records
// arrive again, and the effect on the forces.
#include <signal.h>

#include <CLI/CLI.hpp>
#include <array>
#include <cmath>
#include <cstdio>
#include <random>
#include <sstream>
#include <thread>

#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"
#include "bench/live_session.hpp"
#include "session/figures.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
namespace names = session::figures;
using netem::Side;

struct Settings {
  std::string link = "veth";
  int kills = 100;
  int windows = 20;
  int restarts = 5;
  double calm_s = 20;  // time without kills in which false alarms are counted
  std::uint64_t seed = 1;
};

constexpr double kMaxForce = 8;  // N, the default limit of the HRTC
constexpr auto kWindow = 600ms;  // longer than the effects of a kill
constexpr auto kMetricsPeriod = 500ms;
constexpr const char* kHosts[] = {"east", "west"};
/// Three users whose paths cover the whole object. The pool of their HRTC is smaller than the object, so that records
/// arrive all the time.
constexpr char kExploring[] = R"(name: exploring
duration: 3600
users:
  - name: ann
    hrtc: desk
    repeat: true
    script:
      - approach: {object: organ, direction: [0, 0, 1], speed: 0.15, until_force: 0.5}
      - follow: {speed: 0.05, force: 1, seconds: 3000, pattern: around}
  - name: bob
    hrtc: desk
    repeat: true
    script:
      - approach: {object: organ, direction: [1, 0.3, 0], speed: 0.15, until_force: 0.5}
      - follow: {speed: 0.05, force: 1, seconds: 3000, pattern: around}
  - name: cid
    hrtc: desk
    repeat: true
    script:
      - approach: {object: organ, direction: [0, 1, 0.3], speed: 0.15, until_force: 0.5}
      - follow: {speed: 0.05, force: 1, seconds: 3000, pattern: around}
)";
/// One user whose HRTC has a pool for the whole object.
constexpr char kCollecting[] = R"(name: collecting
duration: 3600
users:
  - name: dan
    hrtc: shelf
    repeat: true
    script:
      - approach: {object: organ, direction: [0, 0, -1], speed: 0.15, until_force: 0.5}
      - follow: {speed: 0.05, force: 1, seconds: 3000, pattern: zigzag}
)";

/// Numbers of records that the HRTC received.
struct ReceivedRecords {
  double received = 0;
  double repeated = 0;            // received although the HRTC held them already
  double repeated_unretired = 0;  // of these, records in the list of a region that is not retired
  ReceivedRecords& operator+=(const ReceivedRecords& other) {
    received += other.received, repeated += other.repeated, repeated_unretired += other.repeated_unretired;
    return *this;
  }
  friend ReceivedRecords operator-(const ReceivedRecords& a, const ReceivedRecords& b) {
    return {a.received - b.received, a.repeated - b.repeated, a.repeated_unretired - b.repeated_unretired};
  }
  [[nodiscard]] double percent(double part) const { return 100 * part / received; }  // NaN if no record was received
};

/// Results of one window.
struct WindowResult {
  ReceivedRecords records;
  double overruns = 0;
  double max_force_step = 0;  // between the states of successive cycles, N/ms
};

/// A session with two hosts of one object, which can be killed and started again.
class Takeover {
 public:
  explicit Takeover(const Settings& settings) : settings_{settings}, random_{settings.seed}, session_{settings.link} {
    const std::string mesh = path("organ.ply");
    run("mesh", {"generate", "organ", mesh, "--faces", "400000", "--seed", "7"});
    run("mesh", {"build", mesh, path("organ.spm"), "--cell-faces", "100"});
    test_support::write_bytes(path("exploring.yaml"), kExploring);
    test_support::write_bytes(path("collecting.yaml"), kCollecting);
  }

  /// Starts both hosts, the HRTC and its users. Returns 3 s after the first contact, when regions arrive and depart.
  void begin() {
    start_host(0);
    desk_ = session_.start(Side::kB, "hrtc", {"--name", "desk", "--pool", "4096", "--no-coding", "--reference-timer"});
    users_ = session_.start(Side::kB, "sim", {"--scenario", path("exploring.yaml")});
    start_host(1);
    session_.wait_until(
        "a contact", [](const ObservedSession& observed) { return touching(observed); }, 60s);
    pause(3s);
  }
  /// Starts the HRTC that holds the whole object, and its user. Returns when it has received regions.
  void begin_restarts() {
    shelf_ = session_.start(Side::kB, "hrtc", {"--name", "shelf", "--pool", "524288"});
    collector_ = session_.start(Side::kB, "sim", {"--name", "collector", "--scenario", path("collecting.yaml")});
    session_.wait_until(
        "a second HRTC's records",
        [](const ObservedSession& observed) { return observed.figure("shelf", names::kRegionsReceived) > 20; }, 60s);
  }

  /// Kills the serving host, measures a window, and starts the host again. `with_control`: first measures a window
  /// without a kill.
  void kill_one(bool with_control) {
    if (with_control) control_windows_.push_back(measure_window([] {}));
    pause(std::chrono::milliseconds{random_() % 200});
    const ObservedSession before = session_.observed();
    const std::size_t serving = before.serving_host == session::id_of(kHosts[0]) ? 0 : 1;
    std::int64_t killed_ns = 0;
    kill_windows_.push_back(measure_window([&] {
      killed_ns = realtime::monotonic_ns();
      hosts_[serving]->signal(SIGKILL);
    }));
    const ObservedSession after = session_.observed();
    const bool moved = after.serving_host == session::id_of(kHosts[1 - serving]);
    detected_ms.add(moved ? static_cast<double>(after.serving_since_ns - killed_ns) * 1e-6 : kUnfinished);
    flowing_ms.add(records_ns_ != 0 ? static_cast<double>(records_ns_ - killed_ns) * 1e-6 : kUnfinished);
    (void)hosts_[serving]->wait(5s);
    restart(serving);
  }

  /// Kills the only host and starts it again. Measures the time until the HRTC with the small pool, which needs records
  /// all the time, has chunks of the new process. Then waits for records for the other HRTC, which must be new.
  void restart_one() {
    const ObservedSession observed = session_.observed();
    const std::size_t serving = observed.serving_host == session::id_of(kHosts[0]) ? 0 : 1;
    if (hosts_[1 - serving]) {
      hosts_[1 - serving]->signal(SIGINT);
      (void)hosts_[1 - serving]->wait(5s);
      hosts_[1 - serving].reset();
      pause(1s);
    }
    const auto received = [](const ObservedSession& now) { return now.figure("shelf", names::kRegionsReceived); };
    const double before = received(session_.observed());
    hosts_[serving]->signal(SIGKILL);
    (void)hosts_[serving]->wait(5s);
    pause(300ms);
    const std::uint64_t desk = session::id_of("desk");
    const std::uint32_t stream = session_.observed().streams[desk].id;
    const std::int64_t started_ns = realtime::monotonic_ns();
    restart(serving);
    session_.wait_until("a chunk of the restarted host", [&](const ObservedSession& now) {
      const auto at = now.streams.find(desk);
      return at != now.streams.end() && at->second.id != stream;
    });
    restarted_ms.add(static_cast<double>(session_.observed().streams[desk].acknowledged_ns - started_ns) * 1e-6);
    session_.wait_until("records after a restart",
                        [&](const ObservedSession& now) { return received(now) > before + 1; });
  }

  /// Counts false alarms without kills while all cores are busy.
  void count_busy_alarms() {
    std::atomic<bool> stop{false};
    std::vector<std::thread> spinners;
    for (unsigned i = 0; i < std::thread::hardware_concurrency(); ++i)
      spinners.emplace_back([&stop] {
        while (!stop) {
        }
      });
    const double before = alarms();
    pause(std::chrono::milliseconds{static_cast<int>(settings_.calm_s * 1e3)});
    stop = true;
    for (std::thread& spinner : spinners) spinner.join();
    pause(2 * kMetricsPeriod);
    busy_alarms_ = alarms() - before;
  }
  /// Counts false alarms without kills.
  void count_calm_alarms() {
    const double before = alarms();
    pause(std::chrono::milliseconds{static_cast<int>(settings_.calm_s * 1e3)});
    pause(2 * kMetricsPeriod);
    calm_alarms_ = alarms() - before;
  }

  [[nodiscard]] double figure(const char* name, const char* hrtc = "desk") const {
    return session_.observed().figure(hrtc, name);
  }
  [[nodiscard]] ReceivedRecords records() const {
    return {figure(names::kRecordsReceived), figure(names::kRecordsRepeated), figure(names::kRecordsRepeatedUnretired)};
  }
  [[nodiscard]] double alarms() const { return figure(names::kFalseAlarms); }
  [[nodiscard]] double busy_alarms() const { return busy_alarms_; }
  [[nodiscard]] double calm_alarms() const { return calm_alarms_; }
  [[nodiscard]] const std::vector<WindowResult>& control_windows() const { return control_windows_; }
  [[nodiscard]] const std::vector<WindowResult>& kill_windows() const { return kill_windows_; }
  /// Returns the log lines of the HRTC about overruns.
  [[nodiscard]] std::vector<std::string> logged_overruns() const {
    std::vector<std::string> lines;
    std::istringstream log{desk_->output()};
    for (std::string line; std::getline(log, line);)
      if (line.find("overrun") != std::string::npos) lines.push_back(line);
    return lines;
  }

  Samples detected_ms;   // time from a kill to the first demand to the other host
  Samples flowing_ms;    // time from a kill until records arrive again
  Samples restarted_ms;  // time from the start of the only host until an HRTC acknowledges a chunk of it

 private:
  static bool touching(const ObservedSession& observed) {
    return observed.states.size() > 100 && (observed.states.back().status & session::kInContact) != 0;
  }
  [[nodiscard]] std::string path(const std::string& name) const { return folder_.path() / name; }
  static void run(const std::string& name, std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), program_path(name));
    e2e::Process program{arguments};
    if (program.wait(120s) != 0) throw std::runtime_error{"tactus-" + name + " failed: " + program.output()};
  }
  void start_host(std::size_t which) {
    hosts_[which] =
        session_.start(Side::kA, "host", {"--name", kHosts[which], "--cache", path("cache"), path("organ.spm")});
    session_.wait_until("a host", [&](const ObservedSession& observed) {
      const auto at = observed.roster.find(session::id_of(kHosts[which]));
      return at != observed.roster.end() && !at->second.leaving;
    });
  }
  /// Starts a host again. Waits also until its endpoints have been discovered, which no figure reports.
  void restart(std::size_t which) {
    const std::uint64_t before = session_.observed().roster.at(session::id_of(kHosts[which])).origin.incarnation;
    start_host(which);
    session_.wait_until("the new host", [&](const ObservedSession& observed) {
      return observed.roster.at(session::id_of(kHosts[which])).origin.incarnation > before;
    });
    pause(800ms);
  }

  /// Calls `begin` and measures a window after it.
  template <class Begin>
  WindowResult measure_window(const Begin& begin) {
    const double overruns_before = next_figure(names::kOverruns);
    const ReceivedRecords records_before = records();
    session_.forget_states();
    const std::size_t printed = desk_->output().size();
    begin();
    const std::int64_t end_ns = realtime::monotonic_ns() + std::chrono::nanoseconds{kWindow}.count();
    records_ns_ = wait_for_text(*desk_, printed, "arrive again", kWindow);
    while (realtime::monotonic_ns() < end_ns) pause(10ms);
    WindowResult window;
    const std::vector<ObservedSession::State> states = session_.observed().states;
    std::map<std::uint64_t, ObservedSession::State> last;  // by user
    for (const ObservedSession::State& state : states) {
      const auto [before, first] = last.try_emplace(state.user, state);
      if (!first && state.sequence == before->second.sequence + 1) {
        const std::array<double, 3>&a = before->second.force, &b = state.force;
        const double ms = std::max(1.0, static_cast<double>(state.time_ns - before->second.time_ns) * 1e-6);
        window.max_force_step = std::max(window.max_force_step, std::hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]) / ms);
      }
      before->second = state;
    }
    window.overruns = next_figure(names::kOverruns) - overruns_before;
    window.records = records() - records_before;
    return window;
  }
  /// Returns a figure of the next metrics sample.
  double next_figure(const char* name) {
    const auto time = [](const ObservedSession& observed) {
      const auto at = observed.metrics.find(session::id_of("desk"));
      return at == observed.metrics.end() ? 0 : at->second.origin.time_ns;
    };
    const std::int64_t before = time(session_.observed());
    session_.wait_until("metrics", [&](const ObservedSession& observed) { return time(observed) > before; });
    return figure(name);
  }

  const Settings& settings_;
  test_support::TemporaryFolder folder_;
  std::mt19937_64 random_;
  LiveSession session_;
  std::array<std::unique_ptr<e2e::Process>, 2> hosts_;
  std::unique_ptr<e2e::Process> desk_, users_, shelf_, collector_;
  std::vector<WindowResult> control_windows_, kill_windows_;
  std::int64_t records_ns_ = 0;
  double busy_alarms_ = 0, calm_alarms_ = 0;
};

double sum_overruns(const std::vector<WindowResult>& windows) {
  double sum = 0;
  for (const WindowResult& window : windows) sum += window.overruns;
  return sum;
}

/// Returns the max force step of each window.
Samples max_force_steps(const std::vector<WindowResult>& windows) {
  Samples steps;
  for (const WindowResult& window : windows) steps.add(window.max_force_step);
  return steps;
}

Report run(const Settings& settings) {
  char text[200];
  std::snprintf(text, sizeof text,
                "%d kills, %d windows without a kill, %d restarts of the only host; link %s, seed %llu", settings.kills,
                settings.windows, settings.restarts, settings.link.c_str(),
                static_cast<unsigned long long>(settings.seed));
  Report report{{"a generated organ of 400,000 faces, three users at 5 cm/s", 0, 0, text}};
  // Runs in a thread of its own, which enters a namespace.
  const auto measure = [&] {
    Takeover takeover{settings};
    takeover.begin();
    const double overruns_before = takeover.figure(names::kOverruns);
    const double cycles_before = takeover.figure(names::kCycles);
    const ReceivedRecords before = takeover.records();
    for (int i = 0; i < settings.kills; ++i) {
      std::fprintf(stderr, "\rkill %d of %d ", i + 1, settings.kills);
      takeover.kill_one(i < settings.windows);
    }
    std::fprintf(stderr, "\n");
    ReceivedRecords in_windows;
    for (const WindowResult& window : takeover.kill_windows()) in_windows += window.records;
    const ReceivedRecords between = takeover.records() - before - in_windows;
    const double alarms_while_killing = takeover.alarms();
    const double overruns_while_killing = takeover.figure(names::kOverruns) - overruns_before;
    const double cycles_while_killing = takeover.figure(names::kCycles) - cycles_before;
    takeover.count_calm_alarms();
    takeover.count_busy_alarms();
    takeover.begin_restarts();
    for (int i = 0; i < settings.restarts; ++i) takeover.restart_one();

    const Population kill_windows{"windows with a kill", takeover.kill_windows().size()};
    const Population cycles{"cycles", static_cast<std::size_t>(cycles_while_killing)};
    report.add_percentiles("time from SIGKILL to the first demand to the other host", "kills", "ms",
                           takeover.detected_ms);
    report.add_percentiles("time from SIGKILL until records arrive again", "kills", "ms", takeover.flowing_ms);
    report.add_percentiles("max force step in a window", "windows with a kill", "N/ms",
                           max_force_steps(takeover.kill_windows()));
    report.add_percentiles("max force step in a window", "windows without a kill", "N/ms",
                           max_force_steps(takeover.control_windows()));
    report.add_value("overruns in windows with a kill", kill_windows, "", sum_overruns(takeover.kill_windows()));
    report.add_value("overruns in windows without a kill",
                     {"windows without a kill", takeover.control_windows().size()}, "",
                     sum_overruns(takeover.control_windows()));
    report.add_value("overruns in and between all windows", cycles, "", overruns_while_killing);
    report.add_value("overruns of a timer with 30 us of work, whole run", {"timer", 1}, "",
                     takeover.figure(names::kTimerOverruns));
    for (const auto& [when, records] :
         {std::pair{" in windows with a kill", in_windows}, {" between windows", between}}) {
      const Population received{"records received", static_cast<std::size_t>(records.received)};
      report.add_value(std::string{"records received"} + when, received, "", records.received);
      report.add_value(std::string{"repeated records divided by records received"} + when, received, "%",
                       records.percent(records.repeated));
      report.add_value(
          std::string{"repeated records of regions that are not retired, divided by records received"} + when, received,
          "%", records.percent(records.repeated_unretired));
    }
    report.add_value("false alarms while hosts are killed", {"kills", takeover.kill_windows().size()}, "",
                     alarms_while_killing);
    char without_kills[64];
    std::snprintf(without_kills, sizeof without_kills, "false alarms in %g s without kills", settings.calm_s);
    report.add_value(without_kills, {"run without kills", 1}, "", takeover.calm_alarms());
    report.add_value(without_kills + std::string{", all cores busy"}, {"run without kills", 1}, "",
                     takeover.busy_alarms());
    for (const std::string& line : takeover.logged_overruns()) report.add_note(line);
    report.add_at_most("time from SIGKILL to the first demand to the other host, p99",
                       {"kills", takeover.detected_ms.size()}, "ms", takeover.detected_ms.percentile(0.99), 50);
    report.add_at_most("time from SIGKILL until records arrive again, p99", {"kills", takeover.flowing_ms.size()}, "ms",
                       takeover.flowing_ms.percentile(0.99), 100);
    const double windows = static_cast<double>(std::max<std::size_t>(1, takeover.control_windows().size()));
    report.add_at_most("mean overruns in a window with a kill minus those in a window without", kill_windows, "",
                       sum_overruns(takeover.kill_windows()) / static_cast<double>(takeover.kill_windows().size()) -
                           sum_overruns(takeover.control_windows()) / windows,
                       0);
    report.add_at_most("share of repeated records in windows with a kill minus their share between windows",
                       kill_windows, "%", in_windows.percent(in_windows.repeated) - between.percent(between.repeated),
                       1);
    report.add_at_most("share of repeated records of regions that are not retired", kill_windows, "%",
                       in_windows.percent(in_windows.repeated_unretired), 1);
    report.add_at_most("max force step", kill_windows, "N/ms", max_force_steps(takeover.kill_windows()).max(),
                       0.05 * kMaxForce);
    report.add_at_most(
        "records received again by an HRTC that holds all, from the restarted only host",
        {"records received", static_cast<std::size_t>(takeover.figure(names::kRecordsReceived, "shelf"))}, "",
        takeover.figure(names::kRecordsReceivedAgain, "shelf"), 0);
    if (settings.restarts > 0)
      report.add_at_most("max time from the start of the only host until its HRTC acknowledges a chunk",
                         {"restarts", takeover.restarted_ms.size()}, "ms", takeover.restarted_ms.max(), 1000);
  };
  in_own_thread(measure);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"takeover", "Kills the host that serves a touched object while a second host runs; needs root",
                         "10 kills, 4 windows without a kill, 2 restarts, for CI"};
  app.add_option("--kills", settings.kills, "number of kills")->check(CLI::Range(1, 10000));
  app.add_option("--windows", settings.windows, "windows without a kill, for comparison")->check(CLI::Range(1, 1000));
  app.add_option("--restarts", settings.restarts, "restarts of the only host")->check(CLI::Range(0, 100));
  app.add_option("--calm", settings.calm_s, "time in which false alarms are counted, twice, s")
      ->check(tactus::wire::finite_range(0.0, 3600.0));
  app.add_option("--link", settings.link, "link between hosts and HRTC, as in `tactus-link list`");
  app.add_option("--seed", settings.seed, "seed of the times of the kills");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.kills = 10, settings.windows = 4, settings.restarts = 2, settings.calm_s = 5;
    return tactus::bench::run(settings);
  });
}
