// The host that serves a touched object is killed: how soon that is noticed, how soon records come again, what is felt.
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
  double calm_s = 20;
  std::uint64_t seed = 1;
};

constexpr double kMaxForce = 8;  // N, the default limit of the HRTC
constexpr auto kWindow = 600ms;  // after a kill: longer than anything that follows from it
constexpr auto kMetricsPeriod = 500ms;
constexpr const char* kHosts[] = {"east", "west"};
/// Three users on paths over the whole object, whose HRTC can hold a fraction of it: records arrive all the time.
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
/// One user whose HRTC can hold all of it.
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

/// Records received; of these, those that the HRTC held already; of these, those that its last demand listed.
struct Sent {
  double received = 0, repeated = 0, published = 0;
  Sent& operator+=(const Sent& other) {
    received += other.received, repeated += other.repeated, published += other.published;
    return *this;
  }
  friend Sent operator-(const Sent& a, const Sent& b) {
    return {a.received - b.received, a.repeated - b.repeated, a.published - b.published};
  }
  [[nodiscard]] double share(double of) const { return 100 * of / received; }  // %, NaN when nothing came
};

/// Of one window in which probe states were kept.
struct Felt {
  Sent sent;
  double overruns = 0;
  double largest_step = 0;  // N/ms, between states that follow each other, of a cycle each
};

class Takeover {
 public:
  explicit Takeover(const Settings& settings) : settings_{settings}, random_{settings.seed}, session_{settings.link} {
    const std::string mesh = path("organ.ply");
    run("mesh", {"generate", "organ", mesh, "--faces", "400000", "--seed", "7"});
    run("mesh", {"build", mesh, path("organ.spm"), "--cell-faces", "100"});
    test_support::write_bytes(path("exploring.yaml"), kExploring);
    test_support::write_bytes(path("collecting.yaml"), kCollecting);
  }

  /// Both hosts, the HRTC and its user; until the object is touched and regions come and go.
  void begin() {
    start_host(0);
    desk_ = session_.start(Side::kB, "hrtc", {"--name", "desk", "--pool", "4096", "--no-coding", "--timer-beside"});
    users_ = session_.start(Side::kB, "sim", {"--scenario", path("exploring.yaml")});
    start_host(1);
    session_.until(
        "a touch", [](const SeenSession& seen) { return touching(seen); }, 60s);
    pause(3s);
  }
  /// The same for an HRTC without loss and a host alone.
  void begin_alone() {
    shelf_ = session_.start(Side::kB, "hrtc", {"--name", "shelf", "--pool", "524288"});
    collector_ = session_.start(Side::kB, "sim", {"--name", "collector", "--scenario", path("collecting.yaml")});
    session_.until(
        "a second HRTC's records",
        [](const SeenSession& seen) { return seen.figure("shelf", names::kRegionsReceived) > 20; }, 60s);
  }

  void kill_one(bool with_window) {
    if (with_window) quiet_.push_back(watch([] {}));
    pause(std::chrono::milliseconds{random_() % 200});
    const SeenSession before = session_.seen();
    const std::size_t serving = before.serving_host == session::id_of(kHosts[0]) ? 0 : 1;
    std::int64_t killed_ns = 0;
    killed_.push_back(watch([&] {
      killed_ns = wire::monotonic_ns();
      hosts_[serving]->signal(SIGKILL);
    }));
    const SeenSession after = session_.seen();
    const bool moved = after.serving_host == session::id_of(kHosts[1 - serving]);
    detected_ms.add(moved ? static_cast<double>(after.serving_since_ns - killed_ns) * 1e-6 : kUnfinished);
    flowing_ms.add(flowed_ns_ != 0 ? static_cast<double>(flowed_ns_ - killed_ns) * 1e-6 : kUnfinished);
    (void)hosts_[serving]->wait(5s);
    restart(serving);
  }

  /// One host alone, killed and started again: what comes then must be new.
  void restart_one() {
    const SeenSession seen = session_.seen();
    const std::size_t serving = seen.serving_host == session::id_of(kHosts[0]) ? 0 : 1;
    if (hosts_[1 - serving]) {
      hosts_[1 - serving]->signal(SIGINT);
      (void)hosts_[1 - serving]->wait(5s);
      hosts_[1 - serving].reset();
      pause(1s);
    }
    const auto received = [](const SeenSession& now) { return now.figure("shelf", names::kRegionsReceived); };
    const double before = received(session_.seen());
    hosts_[serving]->signal(SIGKILL);
    (void)hosts_[serving]->wait(5s);
    pause(300ms);
    restart(serving);
    session_.until("records after a restart", [&](const SeenSession& now) { return received(now) > before + 1; });
  }

  /// Nobody is killed while the machine is busy with something else.
  void busy_calm() {
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
  void calm() {
    const double before = alarms();
    pause(std::chrono::milliseconds{static_cast<int>(settings_.calm_s * 1e3)});
    pause(2 * kMetricsPeriod);
    calm_alarms_ = alarms() - before;
  }

  [[nodiscard]] double figure(const char* name, const char* hrtc = "desk") const {
    return session_.seen().figure(hrtc, name);
  }
  [[nodiscard]] Sent sent() const {
    return {figure(names::kRecordsReceived), figure(names::kRecordsRepeated), figure(names::kRecordsPublished)};
  }
  [[nodiscard]] double alarms() const { return figure(names::kFalseAlarms); }
  [[nodiscard]] double busy_alarms() const { return busy_alarms_; }
  [[nodiscard]] double calm_alarms() const { return calm_alarms_; }
  [[nodiscard]] const std::vector<Felt>& quiet() const { return quiet_; }
  [[nodiscard]] const std::vector<Felt>& killed() const { return killed_; }
  /// What the HRTC logged of its overruns.
  [[nodiscard]] std::vector<std::string> logged_overruns() const {
    std::vector<std::string> lines;
    std::istringstream log{desk_->output()};
    for (std::string line; std::getline(log, line);)
      if (line.find("overrun") != std::string::npos) lines.push_back(line);
    return lines;
  }

  Samples detected_ms, flowing_ms;

 private:
  static bool touching(const SeenSession& seen) {
    return seen.states.size() > 100 && (seen.states.back().status & session::kInContact) != 0;
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
    session_.until("a host", [&](const SeenSession& seen) {
      const auto at = seen.roster.find(session::id_of(kHosts[which]));
      return at != seen.roster.end() && !at->second.leaving;
    });
  }
  /// Until its streams are found, which nobody outside can see.
  void restart(std::size_t which) {
    const std::uint64_t before = session_.seen().roster.at(session::id_of(kHosts[which])).origin.incarnation;
    start_host(which);
    session_.until("the new host", [&](const SeenSession& seen) {
      return seen.roster.at(session::id_of(kHosts[which])).origin.incarnation > before;
    });
    pause(800ms);
  }

  template <class Happen>
  Felt watch(const Happen& happen) {
    const double late = settled(names::kOverruns);
    const Sent sent_before = sent();
    session_.forget_states();
    const std::size_t printed = desk_->output().size();
    happen();
    const std::int64_t end_ns = wire::monotonic_ns() + std::chrono::nanoseconds{kWindow}.count();
    flowed_ns_ = wait_for_text(*desk_, printed, "come again", kWindow);
    while (wire::monotonic_ns() < end_ns) pause(10ms);
    Felt felt;
    const std::vector<SeenSession::State> states = session_.seen().states;
    std::map<std::uint64_t, SeenSession::State> last;  // by user
    for (const SeenSession::State& state : states) {
      const auto [before, first] = last.try_emplace(state.user, state);
      if (!first && state.sequence == before->second.sequence + 1) {
        const std::array<double, 3>&a = before->second.force, &b = state.force;
        const double ms = std::max(1.0, static_cast<double>(state.time_ns - before->second.time_ns) * 1e-6);
        felt.largest_step = std::max(felt.largest_step, std::hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]) / ms);
      }
      before->second = state;
    }
    felt.overruns = settled(names::kOverruns) - late;
    felt.sent = sent() - sent_before;
    return felt;
  }
  /// A figure as a metrics sample to come has it.
  double settled(const char* name) {
    const auto time = [](const SeenSession& seen) {
      const auto at = seen.metrics.find(session::id_of("desk"));
      return at == seen.metrics.end() ? 0 : at->second.origin.time_ns;
    };
    const std::int64_t before = time(session_.seen());
    session_.until("metrics", [&](const SeenSession& seen) { return time(seen) > before; });
    return figure(name);
  }

  const Settings& settings_;
  test_support::TemporaryFolder folder_;
  std::mt19937_64 random_;
  LiveSession session_;
  std::array<std::unique_ptr<e2e::Process>, 2> hosts_;
  std::unique_ptr<e2e::Process> desk_, users_, shelf_, collector_;
  std::vector<Felt> quiet_, killed_;
  std::int64_t flowed_ns_ = 0;
  double busy_alarms_ = 0, calm_alarms_ = 0;
};

double sum_overruns(const std::vector<Felt>& windows) {
  double sum = 0;
  for (const Felt& window : windows) sum += window.overruns;
  return sum;
}

Samples steps_of(const std::vector<Felt>& windows) {
  Samples steps;
  for (const Felt& window : windows) steps.add(window.largest_step);
  return steps;
}

Report run(const Settings& settings) {
  char text[200];
  std::snprintf(text, sizeof text, "%d kills, %d windows without, %d restarts of a host alone; link %s, seed %llu",
                settings.kills, settings.windows, settings.restarts, settings.link.c_str(),
                static_cast<unsigned long long>(settings.seed));
  Report report{{"a generated organ of 400,000 faces, three users at 5 cm/s", 0, 0, text}};
  // A thread of its own, which stays in a namespace.
  const auto measure = [&] {
    Takeover takeover{settings};
    takeover.begin();
    const double late_before = takeover.figure(names::kOverruns);
    const Sent before = takeover.sent();
    for (int i = 0; i < settings.kills; ++i) {
      std::fprintf(stderr, "\rkill %d of %d ", i + 1, settings.kills);
      takeover.kill_one(i < settings.windows);
    }
    std::fprintf(stderr, "\n");
    Sent in_windows;  // that follow a kill, and what came between them in the same minutes
    for (const Felt& window : takeover.killed()) in_windows += window.sent;
    const Sent between = takeover.sent() - before - in_windows;
    const double alarms_while_killing = takeover.alarms();
    const double late_while_killing = takeover.figure(names::kOverruns) - late_before;
    takeover.calm();
    takeover.busy_calm();
    takeover.begin_alone();
    for (int i = 0; i < settings.restarts; ++i) takeover.restart_one();

    report.row("death detected", "from SIGKILL to the demand", "ms", takeover.detected_ms);
    report.row("records flow again", "from SIGKILL", "ms", takeover.flowing_ms);
    report.row("largest force step", {"windows with a kill", takeover.killed().size()}, "N/ms",
               steps_of(takeover.killed()));
    report.row("largest force step", "windows without", "N/ms", steps_of(takeover.quiet()));
    report.figure("overruns", "windows with a kill", "", sum_overruns(takeover.killed()));
    report.figure("overruns", "windows without", "", sum_overruns(takeover.quiet()));
    report.figure("overruns", "windows and the time between them", "", late_while_killing);
    report.figure("overruns of a timer with 30 us of work", "the whole run", "",
                  takeover.figure(names::kTimerOverruns));
    for (const auto& [when, sent] : {std::pair{"windows with a kill", in_windows}, {"the time between", between}}) {
      report.figure("records received", when, "", sent.received);
      report.figure("records that were here", when, "%", sent.share(sent.repeated));
      report.figure("records that the last demand listed as held", when, "%", sent.share(sent.published));
    }
    report.figure("false alarms", "while hosts were killed", "", alarms_while_killing);
    char calm[64];
    std::snprintf(calm, sizeof calm, "%g s, nobody killed", settings.calm_s);
    report.figure("false alarms", calm, "", takeover.calm_alarms());
    report.figure("false alarms", "the same, cores busy", "", takeover.busy_alarms());
    for (const std::string& line : takeover.logged_overruns()) report.note(line);
    report.at_most("death detected, p99", {"kills", takeover.detected_ms.size()}, "ms",
                   takeover.detected_ms.percentile(0.99), 50);
    report.at_most("records flow again, p99", {"kills", takeover.flowing_ms.size()}, "ms",
                   takeover.flowing_ms.percentile(0.99), 100);
    const double windows = static_cast<double>(std::max<std::size_t>(1, takeover.quiet().size()));
    report.at_most("overruns", {"each window with a kill, over those without", takeover.killed().size()}, "",
                   sum_overruns(takeover.killed()) / static_cast<double>(takeover.killed().size()) -
                       sum_overruns(takeover.quiet()) / windows,
                   0);
    report.at_most("records sent again", {"in windows with a kill, over the time between", takeover.killed().size()},
                   "%", in_windows.share(in_windows.repeated) - between.share(between.repeated), 1);
    report.at_most("records sent again",
                   {"listed as held in the last demand, in windows with a kill", takeover.killed().size()}, "%",
                   in_windows.share(in_windows.published), 1);
    report.at_most("largest force step", {"windows with a kill", takeover.killed().size()}, "N/ms",
                   steps_of(takeover.killed()).max(), 0.05 * kMaxForce);
    report.at_most("records sent again", "to one that keeps all, by a host alone that restarts", "",
                   takeover.figure(names::kRecordsReturned, "shelf"), 0);
  };
  in_own_thread(measure);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"takeover",
                         "Kills of the host that serves a touched object, with a second host present; needs root",
                         "10 kills, for CI"};
  app.add_option("--kills", settings.kills, "how many")->check(CLI::Range(1, 10000));
  app.add_option("--windows", settings.windows, "without a kill, for comparison")->check(CLI::Range(1, 1000));
  app.add_option("--restarts", settings.restarts, "of a host that is alone")->check(CLI::Range(0, 100));
  app.add_option("--calm", settings.calm_s, "s in which false alarms are counted, twice")
      ->check(CLI::Range(0.0, 3600.0));
  app.add_option("--link", settings.link, "between hosts and HRTC, as in `tactus-link list`");
  app.add_option("--seed", settings.seed, "of the moments of the kills");
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.kills = 10, settings.windows = 4, settings.restarts = 2, settings.calm_s = 5;
    return tactus::bench::run(settings);
  });
}
