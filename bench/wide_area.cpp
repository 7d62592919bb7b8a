// Runs sessions over emulated wide-area links: the demo, and a session whose forces are compared with the ground truth.
#include <signal.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>

#include "bench/figures.hpp"
#include "bench/latency_bench.hpp"
#include "bench/live_session.hpp"
#include "bench/models.hpp"
#include "bench/session_run.hpp"
#include "bench/surface_path.hpp"
#include "session/figures.hpp"
#include "spm/fcl/fixed_mesh.hpp"
#include "spm/offline/model_file.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

using namespace std::chrono_literals;
namespace names = session::figures;
using netem::Side;
using spm::Vec3d;

struct Settings {
  std::string part, profiles = "P0,P1,P2,P3,P4,P5,P6,P7,P8", demo_profiles = "P4,P6";
  std::uint32_t faces = 400'000, demo_faces = 500'000;
  double seconds = 15;  // of motion on the object, in each session
};

constexpr double kRadius = 0.003;       // of the tips, m
constexpr double kDepth = 0.001;        // of the tips in the surface, m
constexpr double kLength = 0.2;         // of the organ, m
constexpr double kPeriod = 0.001;       // s
constexpr double kFollowSpeed = 0.05;   // m/s
constexpr double kTapSpeed = 0.15;      // m/s
constexpr double kTapHeight = 0.015;    // m
constexpr double kTapDistance = 0.015;  // between taps along the surface, so that each tap needs new regions, m
constexpr double kRestTime = 6;         // above the surface before the motion, while the base mesh arrives, s
const std::string kUsers[] = {"tap", "follow"};

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> parts;
  std::stringstream stream{text};
  for (std::string part; std::getline(stream, part, ',');) parts.push_back(part);
  return parts;
}

// ---- the demo

/// Contact of one user in the demo.
struct DemoUser {
  std::string name;
  double contact_s, exact_share;
};
/// Results of one demo.
struct DemoRun {
  std::vector<DemoUser> users;
  std::size_t hrtcs = 0;
  double overruns = 0, timer_overruns = 0, cycles = 0, contact_cycles = 0, exact_cycles = 0;  // of both HRTCs
};

/// Runs the demo with the hosts on one side of a link and the HRTCs and users on the other.
class Demo {
 public:
  explicit Demo(const Settings& settings) : settings_{settings} {
    build_model("organ", settings.demo_faces, "0.2");
    build_model("terrain", settings.demo_faces * 4 / 5, "0.3");
  }
  DemoRun run(const std::string& link) {
    DemoRun demo;
    in_own_thread([&] {
      LiveSession session{link};
      const auto a = session.start(Side::kA, "host", {"--name", "host-a", path("organ.spm")});
      const auto b =
          session.start(Side::kA, "host", {"--name", "host-b", path("terrain.spm"), "--at", "0.5", "0", "0"});
      std::vector<std::unique_ptr<e2e::Process>> hrtcs;
      for (const char* name : {"hrtc-1", "hrtc-2"})
        hrtcs.push_back(
            session.start(Side::kB, "hrtc", {"--name", name, "--pool", std::to_string(kPool), "--reference-timer"}));
      const std::string report = path("report.json");
      const auto sim = session.start(
          Side::kB, "sim", {"--scenario", "demo", "--seconds", std::to_string(settings_.seconds), "--json", report});
      const auto status = sim->wait(std::chrono::seconds{static_cast<int>(settings_.seconds) + 60});
      if (status != 0) throw std::runtime_error("tactus-sim failed: " + sim->output());
      demo = read(report);
    });
    return demo;
  }

 private:
  static constexpr int kPool = 18'235;  // slots; scripts/demo computes this number for its models
  void build_model(const std::string& kind, std::uint32_t faces, const std::string& size) {
    const auto mesh = [](std::vector<std::string> arguments) {
      arguments.insert(arguments.begin(), program_path("mesh"));
      e2e::Process program{arguments};
      if (program.wait(120s) != 0) throw std::runtime_error{"tactus-mesh failed: " + program.output()};
    };
    mesh({"generate", kind, path(kind + ".ply"), "--faces", std::to_string(faces), "--seed", "1"});
    mesh({"build", path(kind + ".ply"), path(kind + ".spm"), "--size", size});
  }
  static DemoRun read(const std::string& file) {
    std::ifstream in{file};
    const nlohmann::json report = nlohmann::json::parse(in);
    DemoRun run;
    for (const auto& user : report.at("users"))
      run.users.push_back({user.at("name"), user.at("contact_s"), user.at("exact_share")});
    for (const auto& participant : report.at("participants")) {
      const auto& figures = participant.at("figures");
      if (participant.at("role") != "hrtc") continue;
      ++run.hrtcs;
      run.overruns += figures.at(names::kOverruns).get<double>();
      run.timer_overruns += figures.value(names::kTimerOverruns, 0.0);
      run.cycles += figures.at(names::kCycles).get<double>();
      run.contact_cycles += figures.at(names::kContactCycles).get<double>();
      run.exact_cycles += figures.at(names::kExactCycles).get<double>();
    }
    return run;
  }
  [[nodiscard]] std::string path(const std::string& name) const { return folder_.path() / name; }

  const Settings& settings_;
  test_support::TemporaryFolder folder_;
};

void report_demo(const Settings& settings, Report& report) {
  std::fprintf(stderr, "building the demo's models\n");
  Demo demo{settings};
  for (const std::string& link : split(settings.demo_profiles)) {
    std::fprintf(stderr, "demo over %s\n", link.c_str());
    const DemoRun run = demo.run(link);
    const Population cycles{"cycles of both HRTCs", static_cast<std::size_t>(run.cycles)};
    for (const DemoUser& user : run.users) {
      report.add_value("demo, " + link + ": contact time of " + user.name, {"user", 1}, "s", user.contact_s);
      report.add_value("demo, " + link + ": exact contact time divided by contact time, " + user.name, {"user", 1}, "%",
                       100 * user.exact_share);
    }
    report.add_value("demo, " + link + ": overruns of timers with 30 us of work", {"timers", run.hrtcs}, "",
                     run.timer_overruns);
    report.add_at_most("demo, " + link + ": overruns of both HRTCs minus overruns of timers", cycles, "",
                       std::max(0.0, run.overruns - run.timer_overruns), 0);
    report.add_at_least("demo, " + link + ": exact contact cycles divided by contact cycles",
                        {"contact cycles", static_cast<std::size_t>(run.contact_cycles)}, "%",
                        100 * run.exact_cycles / run.contact_cycles, 95);
  }
}

// ---- forces

using States = std::vector<session::ProbeState>;

/// A model, and the recorded paths of two tips on it.
class Subject {
 public:
  explicit Subject(const Settings& settings) : loaded{load_model({}, settings.faces)} {
    scale = kLength * loaded.model.summary.metres_per_unit / model_length(loaded.model.summary);
    spm::offline::write_model(path("model.spm"), loaded.model, {});
    std::ofstream config{path("host.yaml")};
    config.precision(17);
    config << "objects:\n  - name: object\n    model: " << path("model.spm")
           << "\n    position: [0, 0, 0]\n    scale: " << scale << '\n';
    if (!config.flush()) throw std::runtime_error("cannot write " + path("host.yaml"));
    write_tapping(settings.seconds);
    write_following(settings.seconds);
  }
  [[nodiscard]] std::string path(const std::string& file) const { return folder_.path() / file; }

  LoadedModel loaded;
  double scale = 1;       // metres in a file unit
  double duration_s = 0;  // of the longer path

 private:
  /// Returns `count` poses of a tip on the surface. Successive centres are `step` apart. World frame, metres.
  [[nodiscard]] std::vector<SurfacePose> surface_poses_at(double step, double count, std::uint64_t seed) const {
    const spm::fcl::FixedMesh finest{loaded.model.positions, loaded.finest};
    const PathSettings settings{kRadius / scale, kDepth / scale, step / scale, static_cast<std::uint32_t>(count), seed};
    std::vector<SurfacePose> poses = surface_poses(loaded.model.positions, loaded.finest, settings,
                                                   [&](const Vec3d& at) { return finest.distance(at); });
    for (SurfacePose& pose : poses) pose.centre *= scale;
    return poses;
  }
  /// Writes the path of a device as a polyline with times.
  class PathWriter {
   public:
    explicit PathWriter(const std::string& file) : out_{file} { out_.precision(9); }
    void point_at(double seconds, const Vec3d& point) {
      out_ << seconds << ',' << point[0] << ',' << point[1] << ',' << point[2] << '\n';
      time_ = seconds;
      point_ = point;
    }
    void move_to(const Vec3d& point, double speed) {
      point_at(time_ + std::max(kPeriod, (point - point_).norm() / speed), point);
    }
    /// Returns the duration of the path, s.
    [[nodiscard]] double finish() {
      if (!out_.flush()) throw std::runtime_error("cannot write a recording");
      return time_;
    }

   private:
    std::ofstream out_;
    double time_ = 0;
    Vec3d point_ = Vec3d::Zero();
  };
  void write_tapping(double seconds) {
    constexpr double kTravel = 0.1;  // m/s
    const double tap_s = 2 * kTapHeight / kTapSpeed + kTapDistance / kTravel;
    const std::vector<SurfacePose> poses = surface_poses_at(kTapDistance, seconds / tap_s, 1);
    PathWriter writer{path("tap.csv")};
    const auto above = [](const SurfacePose& pose) { return Vec3d{pose.centre + kTapHeight * pose.normal}; };
    writer.point_at(0, above(poses.front()));
    writer.point_at(kRestTime, above(poses.front()));
    for (const SurfacePose& pose : poses) {
      writer.move_to(above(pose), kTravel);
      writer.move_to(pose.centre, kTapSpeed);
      writer.move_to(above(pose), kTapSpeed);
    }
    duration_s = std::max(duration_s, writer.finish());
  }
  void write_following(double seconds) {
    const std::vector<SurfacePose> poses = surface_poses_at(kFollowSpeed * kPeriod, seconds / kPeriod, 2);
    PathWriter writer{path("follow.csv")};
    const Vec3d above = poses.front().centre + kTapHeight * poses.front().normal;
    writer.point_at(0, above);
    writer.point_at(kRestTime, above);
    for (const SurfacePose& pose : poses) writer.move_to(pose.centre, kFollowSpeed);
    duration_s = std::max(duration_s, writer.finish());
  }

  test_support::TemporaryFolder folder_;
};

/// Replays both paths at an HRTC behind `link`. Returns the full-rate states of both users.
std::array<States, 2> receive_states(const Subject& subject, const std::string& link) {
  std::array<States, 2> states;
  in_own_thread([&] {
    LiveSession session{link};
    std::mutex mutex;
    wire::Participants links{session.address("receiver")};
    const wire::Reader<session::ProbeState> reader{links, wire::topics::kProbeState, [&](session::ProbeState&& state) {
                                                     const std::lock_guard lock{mutex};
                                                     for (std::size_t i = 0; i < states.size(); ++i)
                                                       if (state.user_id == session::id_of(kUsers[i]))
                                                         states[i].push_back(state);
                                                   }};
    const auto host = session.start(Side::kA, "host", {"--name", "host", "--config", subject.path("host.yaml")});
    std::vector<std::string> arguments{"--name", "desk", "--users", "2", "--no-coding"};
    for (const std::string& user : kUsers)
      arguments.insert(arguments.end(), {"--replay", user + "=" + subject.path(user + ".csv")});
    const auto hrtc = session.start(Side::kB, "hrtc", arguments);
    session.wait_until("a probe", [](const ObservedSession& observed) { return !observed.states.empty(); });
    pause(std::chrono::milliseconds{static_cast<int>(1e3 * subject.duration_s)});
    hrtc->signal(SIGTERM);
    (void)hrtc->wait();
  });
  return states;
}

/// Errors of the forces against the ground truth, in cycles with a contact in the session or in the ground truth.
struct Fidelity {
  double contact_s = 0;  // contact time in the session
  std::size_t contact_cycles = 0;
  double exact_share = 0;  // exact contact cycles divided by contact cycles, in the session
  double rms = 0;          // N
  Samples error_n, error_jnd;
  double noticeable_share = 0;  // cycles with an error above 1 JND divided by cycles
};

/// Compares the forces with those of a local session that holds the whole mesh, at the same positions.
Fidelity compare(const Subject& subject, const States& states) {
  SessionSettings settings;
  settings.pool = spm::PoolSettings::for_slots(subject.loaded.model.summary.parts + 1000);
  SessionRun local{subject.loaded.model, subject.scale, settings};
  if (states.empty()) throw std::runtime_error("no probe state was received");
  const auto position = [](const session::ProbeState& state) {
    return Vec3d{state.device.position[0], state.device.position[1], state.device.position[2]};
  };
  local.settle(position(states.front()));
  Fidelity fidelity;
  double squares = 0, compared = 0, noticeable = 0, exact = 0, in_contact = 0;
  for (const session::ProbeState& state : states) {
    local.prepare(position(state), {state.velocity[0], state.velocity[1], state.velocity[2]});
    const hrtc_service::ProbeOutput& truth = local.cycle(spm::Budget{1u << 20}).probes[0];
    const bool touches = (state.status & session::kInContact) != 0;
    in_contact += touches;
    exact += touches && (state.status & session::kExact) != 0;
    if (!touches && (truth.status & session::kInContact) == 0) continue;
    const Vec3d force = hrtc_service::vec(truth.force);
    const double error = (Vec3d{state.force[0], state.force[1], state.force[2]} - force).norm();
    const double jnd = error / std::max(0.1 * force.norm(), 0.05);
    fidelity.error_n.add(error);
    fidelity.error_jnd.add(jnd);
    squares += error * error;
    noticeable += jnd > 1;
    ++compared;
  }
  if (compared == 0 || in_contact == 0) throw std::runtime_error("no cycle had a contact");
  fidelity.contact_cycles = static_cast<std::size_t>(in_contact);
  fidelity.contact_s = in_contact * kPeriod;
  fidelity.exact_share = exact / in_contact;
  fidelity.rms = std::sqrt(squares / compared);
  fidelity.noticeable_share = noticeable / compared;
  return fidelity;
}

void report_forces(const Settings& settings, Report& report) {
  std::fprintf(stderr, "building a model and two paths\n");
  const Subject subject{settings};
  for (const std::string& link : split(settings.profiles)) {
    std::fprintf(stderr, "forces over %s\n", link.c_str());
    const std::array<States, 2> states = receive_states(subject, link);
    for (std::size_t i = 0; i < states.size(); ++i) {
      const Fidelity fidelity = compare(subject, states[i]);
      const Population compared{"cycles with a contact in session or ground truth", fidelity.error_n.size()};
      const Population contacts{"contact cycles", fidelity.contact_cycles};
      const std::string name = link + ", " + kUsers[i] + ": ";
      report.add_value(name + "contact time", contacts, "s", fidelity.contact_s);
      report.add_value(name + "exact contact cycles divided by contact cycles", contacts, "%",
                       100 * fidelity.exact_share);
      report.add_value(name + "rms error of the force", compared, "N", fidelity.rms);
      report.add_value(name + "p99 error of the force", compared, "JND", fidelity.error_jnd.percentile(0.99));
      report.add_value(name + "cycles with a force error above 1 JND divided by cycles", compared, "%",
                       100 * fidelity.noticeable_share);
      report.add_value(name + "max error of the force", compared, "N", fidelity.error_n.max());
      if (kUsers[i] == "follow" && (link == "P4" || link == "P6"))
        report.add_at_least(name + "exact contact cycles divided by contact cycles, at 5 cm/s", contacts, "%",
                            100 * fidelity.exact_share, 95);
    }
  }
}

Report run(const Settings& settings) {
  char text[160];
  std::snprintf(text, sizeof text,
                "tips of 3 mm for %g s: one follows the surface at %g cm/s, one taps at %g cm/s; 1 mm deep",
                settings.seconds, 100 * kFollowSpeed, 100 * kTapSpeed);
  Report report{{"organ, terrain", 0, settings.faces, text}};
  if (settings.part != "felt") report_demo(settings, report);
  if (settings.part != "demo") report_forces(settings, report);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "wide-area",
      "Runs the demo over wide-area links, and compares forces over each link profile with the ground "
      "truth; needs root",
      "P4 only, 6 s, smaller models, for CI"};
  app.add_option("--seconds", settings.seconds, "time of motion on the object in each session, s")
      ->check(tactus::wire::finite_range(4.0, 3600.0));
  app.add_option("--profiles", settings.profiles,
                 "link profiles for the comparison of forces, as in `tactus-link list`");
  app.add_option("--demo-profiles", settings.demo_profiles, "link profiles for the demo");
  app.add_option("--faces", settings.faces, "faces of the organ for the comparison of forces")
      ->check(CLI::Range(10'000, 10'000'000));
  app.add_option("--part", settings.part, "runs only this part; felt: the comparison of forces")
      ->check(CLI::IsMember({"demo", "felt"}));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.profiles = settings.demo_profiles = "P4";
      settings.seconds = 6;
      settings.faces = settings.demo_faces = 100'000;
    }
    return tactus::bench::run(settings);
  });
}
