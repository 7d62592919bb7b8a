// Is the force on a refined mesh the one of the full mesh, is it where friction says, and does nothing pass?
//
// Poses of a tip that follows and taps go through host, loader and cycle, with a pool too small for the model, and
// beside that, in one process, through a proxy on the finest mesh. Then hands that move at random press into bodies
// that stand and move, and others stroke surfaces whose normals are known exactly.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <utility>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/hrtc_model.hpp"
#include "bench/models.hpp"
#include "bench/session_run.hpp"
#include "bench/touch_path.hpp"
#include "study/full_mesh.hpp"
#include "tests/haptics/friction_run.hpp"
#include "tests/haptics/random_motions.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr double kPeriod = 0.001;  // s

struct Settings {
  std::string model;
  std::uint32_t faces = 1'000'000;
  std::uint32_t cycles = 1'000'000;
  std::uint64_t motions = 10'000'000;
  std::uint64_t friction_cycles = 100'000;  // cycles of each
  double radius = 0.0015;                   // m
  double speed = 0.05;                      // m/s
  double depth = 0.0005;                    // m
  double pool_share = 0.25;
  session::Material material{2000, 1, 0.5, 0.4};
  std::uint64_t seed = 1;
  bool quick = false;
};

struct Outcome {
  std::uint64_t cycles = 0, contact = 0, resident = 0, different = 0, received = 0, left = 0;
  double worst = 0;  // N
};

bool same_bits(const hrtc_service::Plain3& a, const Vec3d& b) { return std::memcmp(a.data(), b.data(), sizeof a) == 0; }

/// Near regions are resident in a cycle when the surface is exact where tip and proxy are, and was in the cycle before.
/// After any other cycle the proxy on the full mesh takes over where the one on the refined mesh is.
Outcome compare(const LoadedModel& subject, const Settings& settings, const std::vector<Vec3d>& path) {
  const double scale = subject.model.summary.metres_per_unit;
  SessionSettings session;
  session.pool = spm::PoolSettings::for_slots(slots_for(subject.model.summary, settings.pool_share, 8192));
  session.cycle.radius = session.loader.radius = settings.radius;
  session.material = settings.material;
  SessionRun run{subject.model, scale, session};
  run.settle(path.front());

  study::FullMesh full{subject.model.positions, subject.finest, hrtc_service::Placement{{}, scale},
                       settings.radius / 2};
  haptics::Proxy proxy = run.haptic().proxy(0);
  haptics::ForceRenderer renderer = run.haptic().renderer(0);
  const haptics::Feel feel{settings.material.stiffness, settings.material.damping};
  proxy.set_grip({settings.material.static_friction, settings.material.dynamic_friction});

  Outcome outcome;
  bool resident = true;
  for (std::size_t i = 0; i < path.size(); ++i) {
    haptics::DeviceState device;
    device.position = path[i];
    if (i + 1 < path.size()) device.velocity = (path[i + 1] - path[i]) / kPeriod;
    run.prepare(device.position, device.velocity);
    const hrtc_service::ProbeOutput refined = run.cycle(hrtc_service::RefineLimit{}).probes[0];
    const haptics::ProxyResult& at = proxy.step(device.position, kPeriod, full, false);
    const Vec3d force = renderer.step(at, device, feel, 0, kPeriod).force;

    ++outcome.cycles;
    const bool exact = (refined.status & session::kExact) != 0;
    const bool touches = at.in_contact || (refined.status & session::kInContact) != 0;
    if (touches) ++outcome.contact;
    if (exact && resident) {
      if (touches) ++outcome.resident;
      if (!same_bits(refined.force, force) || !same_bits(refined.proxy, at.proxy)) {
        ++outcome.different;
        outcome.worst = std::max(outcome.worst, (hrtc_service::vec(refined.force) - force).norm());
      }
    } else {
      proxy = run.haptic().proxy(0);
      renderer = run.haptic().renderer(0);
    }
    resident = exact;
  }
  outcome.received = run.loader().figures().regions_received;
  outcome.left = run.loader().figures().regions_coarsened;
  return outcome;
}

void compare(const Settings& settings, LoadedModel& subject, Report& report) {
  std::fprintf(stderr, "making the path\n");
  const std::vector<Vec3d> path =
      touch_path(subject, {settings.radius, settings.depth, settings.speed, kPeriod, settings.cycles, settings.seed});
  std::fprintf(stderr, "following and tapping\n");
  const Outcome outcome = compare(subject, settings, path);
  const auto figure = [&](const char* what, const char* population, std::uint64_t value) {
    report.figure(what, population, "", static_cast<double>(value));
  };
  figure("cycles of following and tapping", "all", outcome.cycles);
  figure("cycles in contact", "all", outcome.contact);
  figure("regions received", "all", outcome.received);
  figure("regions that left the pool", "all", outcome.left);
  report.figure("greatest difference of the forces", "near regions resident", "N", outcome.worst);
  report.at_least("near regions resident", {"cycles in contact", outcome.contact}, "%",
                  100.0 * static_cast<double>(outcome.resident) / static_cast<double>(outcome.contact), 99);
  report.at_most("forces or proxies not the same to the bit", {"near regions resident", outcome.resident}, "cycles",
                 static_cast<double>(outcome.different), 0);
}

void move_at_random(const Settings& settings, Report& report) {
  using namespace haptics::testing;
  const std::vector<MotionScene> scenes = motion_scenes();
  std::uint64_t passed = 0, motions = 0;
  double deepest = 0;
  for (const MotionScene& scene : scenes) {
    std::fprintf(stderr, "random motions: %s\n", scene.name.c_str());
    std::uint64_t contacts = 0, pushed = 0, crushed = 0;
    for (const double friction : {0.0, 0.6}) {
      const MotionResult result =
          run_motions(scene, settings.motions / (2 * scenes.size()) + 1, friction, settings.seed);
      motions += result.motions;
      contacts += result.contacts;
      pushed += result.pushed;
      crushed += result.crushed;
      passed += result.passed;
      if (!scene.may_crush) deepest = std::max(deepest, result.deepest);
      if (result.passed > 0) report.note(scene.name + ", friction " + std::to_string(friction) + ": " + result.what);
    }
    report.figure("contact", scene.name, "", static_cast<double>(contacts));
    if (pushed > 0) report.figure("  with what moved", scene.name, "", static_cast<double>(pushed));
    if (crushed > 0) report.figure("  times without any room", scene.name, "", static_cast<double>(crushed));
  }
  report.figure("random motions", "all scenes", "", static_cast<double>(motions));
  report.figure("overlap of proxy and body", "all scenes with room", "um", deepest * 1e6);
  report.at_most("proxies that passed into a body", {"random motions", motions}, "", static_cast<double>(passed), 0);
}

void run_friction_rows(const Settings& settings, Report& report) {
  using namespace haptics::testing;
  constexpr double kSpeed = 0.3;    // m/s at most
  constexpr double kNarrow = 0.01;  // m; in a hollow of this radius the tip's own way bends as much as it is deep
  double stick_error = 0, slip_error = 0, narrow_error = 0, stuck = 0, back = 0;
  for (const double radius : {kNarrow, 0.02, 0.05, 100.0})
    for (const bool hollow : {false, true})
      for (const auto& [sticks, slips] : {std::pair{0.5, 0.3}, {0.8, 0.75}, {0.2, 0.2}}) {
        const FrictionResult result = run_friction(AnalyticSphere{radius, hollow}, sticks, slips, kSpeed,
                                                   settings.friction_cycles, settings.seed);
        stick_error = std::max(stick_error, result.stick_error);
        double& error = radius == kNarrow && hollow ? narrow_error : slip_error;
        error = std::max(error, result.slip_error);
        stuck = std::max(stuck, result.max_stuck);
        back = std::max(back, result.max_return);
      }
  report.figure("force off the dynamic cone", "cycles that slip in a hollow of 10 mm", "%", 100 * narrow_error);
  report.figure("tangential force when it breaks away", "of the static cone's", "%", 100 * stuck);
  report.figure("tangential force when it sticks again, at most", "of the static cone's", "%", 100 * back);
  report.at_most("force outside the static cone", "cycles that stick", "%", 100 * stick_error, 1);
  report.at_most("force off the dynamic cone", "cycles that slip", "%", 100 * slip_error, 1);
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  LoadedModel subject = load_model(settings.model, settings.faces);
  if (settings.model.empty()) scale_to_edge(subject, kHandEdge);
  const spm::ModelSummary& summary = subject.model.summary;
  char text[256];
  std::snprintf(text, sizeof text,
                "radius %g mm, %g cm/s, %g mm deep, friction %g and %g, %g N/m, pool %g of the model, seed %llu",
                settings.radius * 1e3, settings.speed * 1e2, settings.depth * 1e3, settings.material.static_friction,
                settings.material.dynamic_friction, settings.material.stiffness, settings.pool_share,
                static_cast<unsigned long long>(settings.seed));
  Report report{{subject.name, summary.digest, summary.faces, text}};
  compare(settings, subject, report);
  move_at_random(settings, report);
  run_friction_rows(settings, report);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"fidelity",
                         "Forces on a refined mesh beside those on the full one, to the bit; random motions; friction",
                         "20,000 cycles, 10^5 motions, for CI"};
  app.add_option("--model", settings.model, "model file of any kind, or .spm (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--cycles", settings.cycles, "of following and tapping")->check(CLI::Range(2000u, 100000000u));
  app.add_option("--motions", settings.motions, "random ones, over all scenes");
  app.add_option("--speed", settings.speed, "along the surface, m/s")->check(CLI::Range(0.001, 2.0));
  app.add_option("--radius", settings.radius, "of the tip, m")->check(CLI::Range(0.0005, 0.01));
  app.add_option("--pool-share", settings.pool_share, "pool, as a share of the model's records")
      ->check(CLI::Range(0.01, 1.0));
  app.add_option("--seed", settings.seed, "of path and motions");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.cycles = std::min(settings.cycles, 20'000u);
      settings.motions = std::min<std::uint64_t>(settings.motions, 100'000);
      settings.friction_cycles = 20'000;
    }
    return tactus::bench::run(settings);
  });
}
