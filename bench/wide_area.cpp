// Sessions over emulated long ways: the demo's, and what a tip feels against what it feels where the whole mesh is.
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
  double seconds = 15;  // of touching
};

constexpr double kRadius = 0.003;     // m, of the tips
constexpr double kDepth = 0.001;      // m, that they are pressed in
constexpr double kLength = 0.2;       // m, of the organ
constexpr double kPeriod = 0.001;     // s
constexpr double kFollow = 0.05;      // m/s
constexpr double kTap = 0.15;         // m/s
constexpr double kHeight = 0.015;     // m, from which taps begin
constexpr double kTapsApart = 0.015;  // m along the surface: each where nothing has been touched
constexpr double kRest = 6;           // s in the air before anything moves, for the base mesh to come
const std::string kUsers[] = {"tap", "follow"};

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> parts;
  std::stringstream stream{text};
  for (std::string part; std::getline(stream, part, ',');) parts.push_back(part);
  return parts;
}

// ---- the demo

struct DemoUser {
  std::string name;
  double contact_s, exact;
};
struct DemoRun {
  std::vector<DemoUser> users;
  double overruns = 0, timer_overruns = 0, contact = 0, exact = 0;
};

/// Hosts on one side; HRTCs and users on the other.
class Demo {
 public:
  explicit Demo(const Settings& settings) : settings_{settings} {
    make("organ", settings.demo_faces, "0.2");
    make("terrain", settings.demo_faces * 4 / 5, "0.3");
  }
  DemoRun run(const std::string& link) {
    DemoRun demo;
    in_own_thread([&] {
      LiveSession session{link};
      const auto a = session.start(Side::kA, "host", {"--name", "host-a", path("organ.spm")});
      const auto b =
          session.start(Side::kA, "host", {"--name", "host-b", path("terrain.spm"), "--at", "0.5", "0", "0"});
      std::vector<std::unique_ptr<e2e::Process>> HRTCs;
      for (const char* name : {"hrtc-1", "hrtc-2"})
        HRTCs.push_back(
            session.start(Side::kB, "hrtc", {"--name", name, "--pool", std::to_string(kPool), "--timer-beside"}));
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
  static constexpr int kPool = 18'235;  // what scripts/demo gives for these models
  void make(const std::string& kind, std::uint32_t faces, const std::string& size) {
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
      run.overruns += figures.at(names::kOverruns).get<double>();
      run.timer_overruns += figures.value(names::kTimerOverruns, 0.0);
      run.contact += figures.at(names::kContactCycles).get<double>();
      run.exact += figures.at(names::kExactCycles).get<double>();
    }
    return run;
  }
  [[nodiscard]] std::string path(const std::string& name) const { return folder_.path() / name; }

  const Settings& settings_;
  test_support::TemporaryFolder folder_;
};

void report_demo(const Settings& settings, Report& report) {
  std::fprintf(stderr, "making the demo's models\n");
  Demo demo{settings};
  for (const std::string& link : split(settings.demo_profiles)) {
    std::fprintf(stderr, "demo over %s\n", link.c_str());
    const DemoRun run = demo.run(link);
    for (const DemoUser& user : run.users) {
      report.figure("demo, " + link + ": in contact", user.name, "s", user.contact_s);
      report.figure("demo, " + link + ": exact", "contact time of " + user.name, "%", 100 * user.exact);
    }
    report.figure("demo, " + link + ": overruns", "a timer with 30 us of work", "", run.timer_overruns);
    report.at_most("demo, " + link + ": overruns", "cycles of both, beyond the timer's", "",
                   std::max(0.0, run.overruns - run.timer_overruns), 0);
    report.at_least("demo, " + link + ": exact", "contact cycles", "%", 100 * run.exact / run.contact, 95);
  }
}

// ---- what is felt

using States = std::vector<session::ProbeState>;

/// A model, and the ways of two tips on it.
class Subject {
 public:
  explicit Subject(const Settings& settings) : loaded{load_model({}, settings.faces)} {
    scale = kLength * loaded.model.summary.metres_per_unit / longest_side(loaded.model.summary);
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
  double scale = 1;  // m for each unit
  double lasts = 0;  // s, the longer way

 private:
  /// Places `step` apart, world.
  [[nodiscard]] std::vector<SurfacePose> walk(double step, double count, std::uint64_t seed) const {
    const spm::fcl::FixedMesh finest{loaded.model.positions, loaded.finest};
    const PathSettings settings{kRadius / scale, kDepth / scale, step / scale, static_cast<std::uint32_t>(count), seed};
    std::vector<SurfacePose> poses = surface_poses(loaded.model.positions, loaded.finest, settings,
                                                   [&](const Vec3d& at) { return finest.distance(at); });
    for (SurfacePose& pose : poses) pose.centre *= scale;
    return poses;
  }
  /// A device's way, corner by corner.
  class Way {
   public:
    explicit Way(const std::string& file) : out_{file} { out_.precision(9); }
    void at(double seconds, const Vec3d& place) {
      out_ << seconds << ',' << place[0] << ',' << place[1] << ',' << place[2] << '\n';
      time_ = seconds;
      place_ = place;
    }
    void to(const Vec3d& place, double speed) { at(time_ + std::max(kPeriod, (place - place_).norm() / speed), place); }
    [[nodiscard]] double end() {
      if (!out_.flush()) throw std::runtime_error("cannot write a recording");
      return time_;
    }

   private:
    std::ofstream out_;
    double time_ = 0;
    Vec3d place_ = Vec3d::Zero();
  };
  void write_tapping(double seconds) {
    constexpr double kTravel = 0.1;  // m/s
    const double each = 2 * kHeight / kTap + kTapsApart / kTravel;
    const std::vector<SurfacePose> places = walk(kTapsApart, seconds / each, 1);
    Way way{path("tap.csv")};
    const auto above = [](const SurfacePose& pose) { return Vec3d{pose.centre + kHeight * pose.normal}; };
    way.at(0, above(places.front()));
    way.at(kRest, above(places.front()));
    for (const SurfacePose& place : places) {
      way.to(above(place), kTravel);
      way.to(place.centre, kTap);
      way.to(above(place), kTap);
    }
    lasts = std::max(lasts, way.end());
  }
  void write_following(double seconds) {
    const std::vector<SurfacePose> poses = walk(kFollow * kPeriod, seconds / kPeriod, 2);
    Way way{path("follow.csv")};
    const Vec3d above = poses.front().centre + kHeight * poses.front().normal;
    way.at(0, above);
    way.at(kRest, above);
    for (const SurfacePose& pose : poses) way.to(pose.centre, kFollow);
    lasts = std::max(lasts, way.end());
  }

  test_support::TemporaryFolder folder_;
};

/// All states of both users, whole, as their HRTC shows them beyond the link from the host.
std::array<States, 2> feel(const Subject& subject, const std::string& link) {
  std::array<States, 2> felt;
  in_own_thread([&] {
    LiveSession session{link};
    std::mutex mutex;
    wire::Participants links{session.address("ear")};
    const wire::Reader<session::ProbeState> ear{links, wire::topics::kProbeState, [&](session::ProbeState&& state) {
                                                  const std::lock_guard lock{mutex};
                                                  for (std::size_t i = 0; i < felt.size(); ++i)
                                                    if (state.user_id == session::id_of(kUsers[i]))
                                                      felt[i].push_back(std::move(state));
                                                }};
    const auto host = session.start(Side::kA, "host", {"--name", "host", "--config", subject.path("host.yaml")});
    std::vector<std::string> arguments{"--name", "desk", "--users", "2", "--no-coding"};
    for (const std::string& user : kUsers)
      arguments.insert(arguments.end(), {"--replay", user + "=" + subject.path(user + ".csv")});
    const auto hrtc = session.start(Side::kB, "hrtc", arguments);
    session.until("a probe", [](const SeenSession& seen) { return !seen.states.empty(); });
    pause(std::chrono::milliseconds{static_cast<int>(1e3 * subject.lasts)});
    hrtc->signal(SIGTERM);
    (void)hrtc->wait();
  });
  return felt;
}

struct Fidelity {
  double contact_s = 0, exact = 0;  // share of contact
  double rms = 0;                   // N
  Samples error, jnd;               // N; in just noticeable differences; of contact, here or there
  double above = 0;                 // share of contact, here or there, whose error is above one
};

/// Against the same positions where all is at hand.
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
  double squares = 0, contact = 0, above = 0, exact = 0, touching = 0;
  for (const session::ProbeState& state : states) {
    local.prepare(position(state), {state.velocity[0], state.velocity[1], state.velocity[2]});
    const hrtc_service::ProbeOutput& truth = local.cycle(spm::Budget{1u << 20}).probes[0];
    const bool here = (state.status & session::kInContact) != 0;
    touching += here;
    exact += here && (state.status & session::kExact) != 0;
    if (!here && (truth.status & session::kInContact) == 0) continue;
    const Vec3d force = hrtc_service::vec(truth.force);
    const double error = (Vec3d{state.force[0], state.force[1], state.force[2]} - force).norm();
    const double jnd = error / std::max(0.1 * force.norm(), 0.05);
    fidelity.error.add(error);
    fidelity.jnd.add(jnd);
    squares += error * error;
    above += jnd > 1;
    ++contact;
  }
  if (contact == 0 || touching == 0) throw std::runtime_error("nothing was touched");
  fidelity.contact_s = touching * kPeriod;
  fidelity.exact = exact / touching;
  fidelity.rms = std::sqrt(squares / contact);
  fidelity.above = above / contact;
  return fidelity;
}

void report_felt(const Settings& settings, Report& report) {
  std::fprintf(stderr, "making a model and two ways on it\n");
  const Subject subject{settings};
  for (const std::string& link : split(settings.profiles)) {
    std::fprintf(stderr, "feeling over %s\n", link.c_str());
    const std::array<States, 2> felt = feel(subject, link);
    for (std::size_t i = 0; i < felt.size(); ++i) {
      const Fidelity fidelity = compare(subject, felt[i]);
      const std::string name = link + ", " + kUsers[i] + ": ";
      report.figure(name + "exact", std::to_string(static_cast<int>(fidelity.contact_s)) + " s of contact", "%",
                    100 * fidelity.exact);
      report.figure(name + "force error rms", "contact, here or there", "N", fidelity.rms);
      report.figure(name + "force error p99", {"contact, here or there", fidelity.jnd.size()}, "JND",
                    fidelity.jnd.percentile(0.99));
      report.figure(name + "force error above 1 JND", "contact, here or there", "%", 100 * fidelity.above);
      report.figure(name + "force error max", {"contact, here or there", fidelity.error.size()}, "N",
                    fidelity.error.max());
      if (kUsers[i] == "follow" && (link == "P4" || link == "P6"))
        report.at_least(name + "exact", "contact at 5 cm/s", "%", 100 * fidelity.exact, 95);
    }
  }
}

Report run(const Settings& settings) {
  char text[160];
  std::snprintf(text, sizeof text, "3 mm tips for %g s: follow at %g cm/s, tap at %g cm/s, 1 mm deep", settings.seconds,
                100 * kFollow, 100 * kTap);
  Report report{{"organ, terrain", 0, settings.faces, text}};
  if (settings.part != "felt") report_demo(settings, report);
  if (settings.part != "demo") report_felt(settings, report);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"wide-area",
                         "The demo's session over long ways, and what is felt over each named link; needs root",
                         "P4 alone, 6 s, smaller models, for CI"};
  app.add_option("--seconds", settings.seconds, "of touching, in each session")->check(CLI::Range(4.0, 3600.0));
  app.add_option("--profiles", settings.profiles, "links over which is felt, as in `tactus-link list`");
  app.add_option("--demo-profiles", settings.demo_profiles, "links of the demo's session");
  app.add_option("--faces", settings.faces, "of the organ that is felt")->check(CLI::Range(10'000, 10'000'000));
  app.add_option("--part", settings.part, "only this one")->check(CLI::IsMember({"demo", "felt"}));
  return tactus::bench::latency_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.profiles = settings.demo_profiles = "P4";
      settings.seconds = 6;
      settings.faces = settings.demo_faces = 100'000;
    }
    return tactus::bench::run(settings);
  });
}
