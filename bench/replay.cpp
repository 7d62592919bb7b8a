// Replays flight recordings of real sessions and checks that the forces are equal to the bit. Measures the time and
// memory that recording takes.
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
#include "hrtc_service/servo/flight_store.hpp"
#include "realtime/periodic_clock.hpp"
#include "spm/offline/model_file.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
using netem::Side;

struct Settings {
  double seconds = 180;
  std::string output_folder;  // for models and recordings; empty: a temporary folder
  std::string part = "all";
};

constexpr char kObjects[] = R"(objects:
  - name: organ
    model: organ.spm
    material: {stiffness: 800, damping: 2, static_friction: 0.4, dynamic_friction: 0.3}
)";
/// Five users of two HRTCs, whose paths cover the whole object. Two have remote devices.
constexpr char kUsers[] = R"(name: recorded
duration: 7200
users:
  - {name: ann, hrtc: desk, script: [{approach: {object: organ, direction: [0, 0, 1], speed: 0.15}}, {follow: {speed: 0.05, force: 1, seconds: 7000, pattern: around}}]}
  - {name: bob, hrtc: desk, script: [{approach: {object: organ, direction: [1, 0.3, 0], speed: 0.15}}, {follow: {speed: 0.12, force: 2, seconds: 7000, pattern: zigzag}}]}
  - {name: cid, hrtc: desk, remote: true, script: [{approach: {object: organ, direction: [0, 1, 0.3], speed: 0.15}}, {follow: {speed: 0.05, force: 0.5, seconds: 7000, pattern: around}}]}
  - {name: dan, hrtc: shelf, remote: true, script: [{approach: {object: organ, direction: [0, 0, -1], speed: 0.15}}, {follow: {speed: 0.05, force: 0.5, seconds: 7000, pattern: zigzag}}]}
  - {name: eve, hrtc: shelf, script: [{approach: {object: organ, direction: [0, -1, 0], speed: 0.15}}, {follow: {speed: 0.05, force: 1, seconds: 7000, pattern: around}}]}
)";

/// A session with two HRTCs. `desk` records the whole session, `shelf` its last 30 s.
class RecordedSession {
 public:
  RecordedSession(const Settings& settings, const std::filesystem::path& folder)
      : settings_{settings}, folder_{folder}, session_{"veth"} {
    run("mesh", {"generate", "organ", path("organ.ply"), "--faces", "400000", "--seed", "7"});
    run("mesh", {"build", path("organ.ply"), path("organ.spm"), "--cell-faces", "100"});
    test_support::write_bytes(path("objects.yaml"), kObjects);
    test_support::write_bytes(path("users.yaml"), kUsers);
  }

  /// Runs the session until its end, with pauses of the users' poses, a stop and a reset.
  void run_session() {
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
    session_.wait_until(
        "a contact",
        [](const ObservedSession& observed) {
          return std::any_of(observed.states.begin(), observed.states.end(),
                             [](const auto& state) { return (state.status & session::kInContact) != 0; });
        },
        60s);
    const auto share_of_session = [this](double of) {
      return std::chrono::milliseconds{static_cast<int>(settings_.seconds * of * 1e3)};
    };
    for (int part = 0; part < 4; ++part) {  // each with pauses of the users' poses; a stop follows part 1
      pause(share_of_session(0.2));
      for (int i = 0; i < 5; ++i) {
        users_->signal(SIGSTOP);
        pause(10ms + 20ms * i);
        users_->signal(SIGCONT);
        pause(300ms);
      }
      session_.forget_states();
      if (part != 1) continue;
      const std::size_t printed = shelf_->output().size();
      control("stop");
      if (wait_for_text(*shelf_, printed, "flight recording", 20s) == 0)
        throw std::runtime_error("no flight recording of the stop");
      pause(2s);
      control("reset");
    }
    pause(share_of_session(0.2));
    users_->signal(SIGINT);
    for (e2e::Process* const program : {users_.get(), desk_.get(), shelf_.get(), host_.get()})
      if (!program->wait(60s)) throw std::runtime_error("a program did not end: " + program->output());
    for (const auto& entry : std::filesystem::directory_iterator{path("flights")})
      if (entry.path().filename().string().rfind("shelf", 0) == 0) stop_file_ = entry.path();
  }

  [[nodiscard]] std::string path(const std::string& name) const { return folder_ / name; }
  /// Returns the file that `shelf` wrote at the stop.
  [[nodiscard]] const std::string& stop_file() const { return stop_file_; }

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
  std::string stop_file_;
};

/// Replays a recording and adds its rows. `whole`: whether the recording contains the whole session.
void replay(Report& report, const std::string& name, const std::string& file, const spm::codec::CompressedModel& model,
            bool whole) {
  std::fprintf(stderr, "replaying %s\n", name.c_str());
  hrtc_service::FlightReplayOptions options;
  options.model = [&](std::uint64_t digest) { return digest == model.summary().digest ? &model : nullptr; };
  const std::int64_t start_ns = realtime::monotonic_ns();
  const hrtc_service::FlightReport flight = hrtc_service::replay_flight(file, options);
  const double replay_s = static_cast<double>(realtime::monotonic_ns() - start_ns) * 1e-9;
  const Population recording{"recording, " + name, 1}, cycles{"cycles, " + name, flight.cycles};
  const auto count = [&](const char* what, std::uint64_t value) {
    report.add_value(what, cycles, "", static_cast<double>(value));
  };
  report.add_value("length of the recording", recording, "s", flight.seconds);
  count("cycles", flight.cycles);
  count("cycles lost", flight.lost);
  count("forces compared", flight.probe_cycles);
  count("forces compared in contact", flight.in_contact);
  count("forces compared in exact contact", flight.exact);
  count("forces compared of stale poses", flight.stale);
  count("forces compared that a fault set to zero", flight.faulted);
  count("arrivals of regions", flight.regions_arrived);
  count("departures of regions", flight.regions_departed);
  count("cycles whose refinement ended at the deadline", flight.budget_spent);
  count("stops", flight.stops);
  count("resets", flight.resets);
  report.add_value("size of the file", recording, "MiB",
                   static_cast<double>(std::filesystem::file_size(file)) / (1 << 20));
  report.add_value("length of the recording divided by time of the replay", recording, "times",
                   flight.seconds / replay_s);
  if (flight.different_cycles > 0) report.add_note(name + ": first " + flight.first_difference);
  report.add_at_most("cycles whose forces differ in any bit", cycles, "", static_cast<double>(flight.different_cycles),
                     0);
  report.add_at_least("forces compared in contact", cycles, "", static_cast<double>(flight.in_contact),
                      1000 * flight.seconds / 2);
  report.add_at_least("departures of regions", cycles, "", static_cast<double>(flight.regions_departed), 50);
  if (whole) {
    report.add_at_least("forces compared of stale poses", cycles, "", static_cast<double>(flight.stale), 10);
    report.add_at_least("min of stops and resets", cycles, "",
                        static_cast<double>(std::min(flight.stops, flight.resets)), 1);
    report.add_at_least("cycles whose refinement ended at the deadline", cycles, "",
                        static_cast<double>(flight.budget_spent), 10);
  } else {
    report.add_at_least("number of the first cycle", recording, "", static_cast<double>(flight.start.first_cycle), 1);
  }
}

/// Measures the time that the recorder adds to a cycle, with the CPU caches as the cycle leaves them, and the memory
/// for 30 s.
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
    Samples costs_ns, costs_with_state_ns;
    for (int cycle = 0; cycle < kCycles; ++cycle) {
      session.prepare(path[cycle], (path[cycle + 1] - path[cycle]) * 1000);
      (void)session.cycle(spm::Budget{1u << 20});
      for (std::uint32_t i = 0; i < probes; ++i) {
        inputs[i].active = true;
        inputs[i].device.position = path[cycle];
      }
      const std::int64_t start_ns = realtime::monotonic_ns();
      recorder.touched(inputs, start_ns, nullptr, 0, session.haptic().result());
      recorder.refined(session.haptic(), {}, true);
      const auto cost_ns = static_cast<double>(realtime::monotonic_ns() - start_ns);
      (cycle % 1000 == 999 ? costs_with_state_ns : costs_ns).add(cost_ns);
      if (cycle % 20 == 0) store.drain();
    }
    const std::string with_probes = std::to_string(probes) + (probes == 1 ? " probe" : " probes");
    const std::string cycles = "cycles, " + with_probes;
    const Population recorder_of_probes{"recorder, " + with_probes, 1};
    report.add_percentiles("time of the recorder in a cycle", cycles, "ns", costs_ns);
    report.add_percentiles("time of the recorder in a cycle with state, once a second", cycles, "ns",
                           costs_with_state_ns);
    report.add_value("memory in use for 30 s", recorder_of_probes, "MiB",
                     static_cast<double>(store.bytes()) / (1 << 20));
    report.add_value("max memory for 30 s", recorder_of_probes, "MiB",
                     static_cast<double>(hrtc_service::FlightStore::bytes_for(30, 0.001, probes)) / (1 << 20));
    report.add_at_most("time of the recorder in a cycle, p99", {cycles, costs_ns.size()}, "ns",
                       costs_ns.percentile(0.99), 5000);
  }
}

void replay_session(Report& report, const Settings& settings) {
  const test_support::TemporaryFolder folder;
  const std::filesystem::path files =
      settings.output_folder.empty() ? folder.path() : std::filesystem::path{settings.output_folder};
  std::filesystem::create_directories(files);
  std::string stop_file;
  in_own_thread([&] {
    RecordedSession session{settings, files};
    session.run_session();
    stop_file = session.stop_file();
  });
  const spm::offline::MappedModel model{files / "organ.spm"};
  replay(report, "whole session", files / "whole.mcap", model.compressed(), true);
  replay(report, "30 s before a stop", stop_file, model.compressed(), false);
  replay(report, "30 s before the end", files / "end.mcap", model.compressed(), false);
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
  tactus::bench::App app{"replay",
                         "Replays flight recordings of a real session and compares the forces to the bit; needs root",
                         "a session of 90 s, for CI"};
  app.add_option("--seconds", settings.seconds, "length of the session, s")
      ->check(tactus::wire::finite_range(5.0, 3600.0));
  app.add_option("--keep", settings.output_folder, "folder for models and recordings (default: a temporary folder)");
  app.add_option("--part", settings.part,
                 "session: records and replays a session; cost: measures the cost of recording; all: both")
      ->check(CLI::IsMember({"all", "session", "cost"}));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = 90;
    return tactus::bench::run(settings);
  });
}
