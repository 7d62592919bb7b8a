// Flight recordings of real sessions, replayed: do the forces come out the same to the bit? And what recording takes.
#include <signal.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <functional>

#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"
#include "bench/live_session.hpp"
#include "bench/models.hpp"
#include "bench/session_run.hpp"
#include "bench/touch_path.hpp"
#include "hrtc_service/flight_replay.hpp"
#include "hrtc_service/flight_store.hpp"
#include "hrtc_service/realtime.hpp"
#include "spm/offline/model_file.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
using netem::Side;

struct Settings {
  double seconds = 180;
  std::string keep;  // folder
  std::string part = "all";
};

constexpr char kObjects[] = R"(objects:
  - name: organ
    model: organ.spm
    material: {stiffness: 800, damping: 2, static_friction: 0.4, dynamic_friction: 0.3}
)";
/// Five users of two HRTCs, all on their ways over the whole object, two with devices at a distance.
constexpr char kUsers[] = R"(name: recorded
duration: 7200
users:
  - {name: ann, hrtc: desk, script: [{approach: {object: organ, direction: [0, 0, 1], speed: 0.15}}, {follow: {speed: 0.05, force: 1, seconds: 7000, pattern: around}}]}
  - {name: bob, hrtc: desk, script: [{approach: {object: organ, direction: [1, 0.3, 0], speed: 0.15}}, {follow: {speed: 0.12, force: 2, seconds: 7000, pattern: zigzag}}]}
  - {name: cid, hrtc: desk, remote: true, script: [{approach: {object: organ, direction: [0, 1, 0.3], speed: 0.15}}, {follow: {speed: 0.05, force: 0.5, seconds: 7000, pattern: around}}]}
  - {name: dan, hrtc: shelf, remote: true, script: [{approach: {object: organ, direction: [0, 0, -1], speed: 0.15}}, {follow: {speed: 0.05, force: 0.5, seconds: 7000, pattern: zigzag}}]}
  - {name: eve, hrtc: shelf, script: [{approach: {object: organ, direction: [0, -1, 0], speed: 0.15}}, {follow: {speed: 0.05, force: 1, seconds: 7000, pattern: around}}]}
)";

/// A session of programs with two HRTCs: `desk` records all of it, `shelf` keeps its last 30 s.
class Recorded {
 public:
  Recorded(const Settings& settings, const std::filesystem::path& folder)
      : settings_{settings}, folder_{folder}, session_{"veth"} {
    run("mesh", {"generate", "organ", path("organ.ply"), "--faces", "400000", "--seed", "7"});
    run("mesh", {"build", path("organ.ply"), path("organ.spm"), "--cell-faces", "100"});
    test_support::write_bytes(path("objects.yaml"), kObjects);
    test_support::write_bytes(path("users.yaml"), kUsers);
  }

  void play() {
    host_ = session_.start(Side::kA, "host",
                           {"--name", "museum", "--cache", path("cache"), "--config", path("objects.yaml")});
    char whole[32];
    std::snprintf(whole, sizeof whole, "%.0f", settings_.seconds + 120);
    desk_ = session_.start(Side::kB, "hrtc",
                           {"--name", "desk", "--pool", "5000", "--deadline", "150", "--flight-recorder", whole,
                            "--flight-file", path("whole.mcap"), "--flight-folder", path("flights")});
    shelf_ = session_.start(
        Side::kB, "hrtc",
        {"--name", "shelf", "--pool", "4096", "--flight-file", path("end.mcap"), "--flight-folder", path("flights")});
    users_ = session_.start(Side::kB, "sim", {"--scenario", path("users.yaml")});
    session_.until(
        "a touch",
        [](const SeenSession& seen) {
          return std::any_of(seen.states.begin(), seen.states.end(),
                             [](const auto& state) { return (state.status & session::kInContact) != 0; });
        },
        60s);
    const auto share = [this](double of) {
      return std::chrono::milliseconds{static_cast<int>(settings_.seconds * of * 1e3)};
    };
    for (int part = 0; part < 4; ++part) {  // silences, a stop after the second
      pause(share(0.2));
      for (int i = 0; i < 5; ++i) {
        users_->signal(SIGSTOP);
        pause(10ms + 20ms * i);
        users_->signal(SIGCONT);
        pause(300ms);
      }
      session_.forget_states();
      if (part != 1) continue;
      const std::size_t said = shelf_->output().size();
      control("stop");
      if (wait_for_text(*shelf_, said, "flight recording", 20s) == 0)
        throw std::runtime_error("no recording of a stop");
      pause(2s);
      control("reset");
    }
    pause(share(0.2));
    users_->signal(SIGINT);
    for (e2e::Process* const one : {users_.get(), desk_.get(), shelf_.get(), host_.get()})
      if (!one->wait(60s)) throw std::runtime_error("a program does not end: " + one->output());
    for (const auto& entry : std::filesystem::directory_iterator{path("flights")})
      if (entry.path().filename().string().rfind("shelf", 0) == 0) of_stop_ = entry.path();
  }

  [[nodiscard]] std::string path(const std::string& name) const { return folder_ / name; }
  [[nodiscard]] const std::string& of_stop() const { return of_stop_; }

 private:
  static void run(const std::string& name, std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), program_path(name));
    e2e::Process program{arguments};
    if (program.wait(120s) != 0) throw std::runtime_error{"tactus-" + name + " failed: " + program.output()};
  }
  void control(const std::string& command) {
    const auto published = session_.start(Side::kB, "control", {command});
    if (published->wait(20s) != 0) throw std::runtime_error("tactus-control " + command + ": " + published->output());
  }

  const Settings& settings_;
  std::filesystem::path folder_;
  LiveSession session_;
  std::unique_ptr<e2e::Process> host_, desk_, shelf_, users_;
  std::string of_stop_;
};

void replay(Report& report, const std::string& what, const std::string& file, const spm::codec::CompressedModel& model,
            bool whole) {
  std::fprintf(stderr, "replaying %s\n", what.c_str());
  hrtc_service::FlightReplayOptions options;
  options.model = [&](std::uint64_t digest) { return digest == model.summary().digest ? &model : nullptr; };
  const std::int64_t began = hrtc_service::monotonic_ns();
  const hrtc_service::FlightReport had = hrtc_service::replay_flight(file, options);
  const double took = static_cast<double>(hrtc_service::monotonic_ns() - began) * 1e-9;
  const auto count = [&](const char* name, std::uint64_t value) {
    report.figure(name, what, "", static_cast<double>(value));
  };
  report.figure("recorded", what, "s", had.seconds);
  count("cycles", had.cycles);
  count("cycles lost", had.lost);
  count("forces compared", had.probe_cycles);
  count("of these in contact", had.in_contact);
  count("of these exact", had.exact);
  count("of stale poses", had.stale);
  count("off by a fault", had.faulted);
  count("regions that came", had.regions_came);
  count("regions that left", had.regions_left);
  count("cycles cut short by the deadline", had.budget_spent);
  count("stops", had.stops);
  count("resets", had.resets);
  report.figure("file", what, "MiB", static_cast<double>(std::filesystem::file_size(file)) / (1 << 20));
  report.figure("replayed faster than life", what, "times", had.seconds / took);
  if (had.differ > 0) report.note(what + ": first " + had.first_difference);
  report.at_most("cycles that differ in any bit", {what, had.cycles}, "", static_cast<double>(had.differ), 0);
  report.at_least("forces compared in contact", what, "", static_cast<double>(had.in_contact), 1000 * had.seconds / 2);
  report.at_least("regions that came and left", what, "", static_cast<double>(had.regions_left), 50);
  if (whole) {
    report.at_least("forces of stale poses", what, "", static_cast<double>(had.stale), 10);
    report.at_least("stops and resets", what, "", static_cast<double>(std::min(had.stops, had.resets)), 1);
    report.at_least("cycles cut short", what, "", static_cast<double>(had.budget_spent), 10);
  } else {
    report.at_least("begins in the middle, at cycle", what, "", static_cast<double>(had.start.first_cycle), 1);
  }
}

/// What the recorder adds to a cycle, with the caches as a cycle leaves them, and what 30 s of it take.
void measure_cost(Report& report) {
  constexpr int kCycles = 35000;
  for (const std::uint32_t probes : {1u, 8u}) {
    LoadedModel subject = load_model("", 200000);
    SessionSettings settings;
    settings.pool = spm::PoolSettings::for_slots(1u << 15);
    SessionRun session{subject.model, subject.model.summary.metres_per_unit, settings};
    const std::vector<spm::Vec3d> path = touch_path(subject, {0.003, 0.0005, 0.05, 0.001, kCycles + 1, 1});
    session.settle(path[0] * 3);
    hrtc_service::FlightRecorder recorder{1000};
    hrtc_service::FlightStore store{recorder, hrtc_service::flight_start("bench", {}, settings.pool, {}), 30,
                                    hrtc_service::FlightStore::bytes_for(30, 0.001, probes)};
    std::array<hrtc_service::ProbeInput, hrtc_service::kMaxProbes> inputs;
    Samples costs, with_state;
    for (int cycle = 0; cycle < kCycles; ++cycle) {
      session.prepare(path[cycle], (path[cycle + 1] - path[cycle]) * 1000);
      (void)session.cycle(spm::Budget{1u << 20});
      for (std::uint32_t i = 0; i < probes; ++i) {
        inputs[i].active = true;
        inputs[i].device.position = path[cycle];
      }
      const std::int64_t began = hrtc_service::monotonic_ns();
      recorder.touched(inputs, began, nullptr, 0, session.haptic().result());
      recorder.refined(session.haptic(), {}, true);
      const auto took = static_cast<double>(hrtc_service::monotonic_ns() - began);
      (cycle % 1000 == 999 ? with_state : costs).add(took);
      if (cycle % 20 == 0) store.drain();
    }
    const std::string population = std::to_string(probes) + (probes == 1 ? " probe" : " probes");
    report.row("recorder in a cycle", population, "ns", costs);
    report.row("the same once a second, with state", population, "ns", with_state);
    report.figure("memory of 30 s", population, "MiB", static_cast<double>(store.bytes()) / (1 << 20));
    report.figure("memory of 30 s, at most", population, "MiB",
                  static_cast<double>(hrtc_service::FlightStore::bytes_for(30, 0.001, probes)) / (1 << 20));
    report.at_most("recorder in a cycle, p99", {population, costs.size()}, "ns", costs.percentile(0.99), 5000);
  }
}

void replay_session(Report& report, const Settings& settings) {
  const test_support::TemporaryFolder folder;
  const std::filesystem::path at = settings.keep.empty() ? folder.path() : std::filesystem::path{settings.keep};
  std::filesystem::create_directories(at);
  std::string of_stop;
  in_own_thread([&] {
    Recorded session{settings, at};
    session.play();
    of_stop = session.of_stop();
  });
  const spm::offline::MappedModel model{at / "organ.spm"};
  replay(report, "whole session", at / "whole.mcap", model.coded(), true);
  replay(report, "30 s before a stop", of_stop, model.coded(), false);
  replay(report, "30 s before the end", at / "end.mcap", model.coded(), false);
}

Report run(const Settings& settings) {
  char text[160];
  std::snprintf(
      text, sizeof text,
      "%g s, 5 users (2 with remote devices) of 2 HRTCs with pools of 4096 and 5000 slots, friction 0.4 and 0.3",
      settings.seconds);
  Report report{{"a generated organ of 400,000 faces", 0, 0, text}};
  if (settings.part != "cost") replay_session(report, settings);
  if (settings.part != "session") measure_cost(report);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"replay", "Flight recordings of a real session, replayed to the bit; needs root",
                         "90 s, for CI"};
  app.add_option("--seconds", settings.seconds, "of the session")->check(CLI::Range(5.0, 3600.0));
  app.add_option("--keep", settings.keep, "folder for models and recordings, which stay there");
  app.add_option("--part", settings.part, "session: record and replay one; cost: what recording takes; all")
      ->check(CLI::IsMember({"all", "session", "cost"}));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = 90;
    return tactus::bench::run(settings);
  });
}
