// Compares the forces on a refined mesh with those on the full mesh, counts proxies that pass into a body, and compares
// friction forces with the friction law.
//
// First, a tip follows and taps a surface. Host, loader and haptic cycle compute the force at each pose, with a pool
// too small for the model. A proxy on the finest mesh gives a second force at the same pose. Second, hands move at
// random and press into bodies at rest and in motion. Third, hands stroke spheres, whose normals are known exactly.
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
  std::uint64_t friction_cycles = 100'000;  // cycles for each surface and friction
  double radius = 0.0015;                   // m, of the tip
  double speed = 0.05;                      // m/s, of the tip
  double depth = 0.0005;                    // m, overlap of tip and surface
  double pool_share = 0.25;                 // share of the model's records for which the pool has slots
  session::Material material{2000, 1, 0.5, 0.4};
  std::uint64_t seed = 1;
  bool quick = false;
};

struct Comparison {
  std::uint64_t cycles = 0, contact_cycles = 0;
  std::uint64_t compared_cycles = 0, compared_contact_cycles = 0, different_cycles = 0;
  std::uint64_t regions_received = 0, regions_coarsened = 0;
  double max_force_error = 0;  // N, of the compared cycles
};

bool same_bits(const hrtc_service::Plain3& a, const Vec3d& b) { return std::memcmp(a.data(), b.data(), sizeof a) == 0; }

/// Compares the two forces in each cycle that is exact and follows an exact cycle. After any other cycle, copies the
/// state of the proxy on the refined mesh to the proxy on the full mesh.
Comparison compare(const LoadedModel& subject, const Settings& settings, const std::vector<Vec3d>& path) {
  constexpr std::uint32_t kMinRecordSlots = 8192;
  const double scale = subject.model.summary.metres_per_unit;
  SessionSettings session;
  session.pool = spm::PoolSettings::for_slots(slots_for(subject.model.summary, settings.pool_share, kMinRecordSlots));
  session.cycle.radius = session.loader.radius = settings.radius;
  session.material = settings.material;
  SessionRun run{subject.model, scale, session};
  run.settle(path.front());

  const double grid_cell = settings.radius / 2;
  study::FullMesh full{subject.model.positions, subject.finest, hrtc_service::Placement{{}, scale}, grid_cell};
  haptics::Proxy proxy = run.haptic().proxy(0);
  haptics::ForceRenderer renderer = run.haptic().renderer(0);
  const haptics::ContactImpedance impedance{settings.material.stiffness, settings.material.damping};
  proxy.set_grip({settings.material.static_friction, settings.material.dynamic_friction});

  Comparison outcome;
  bool was_exact = true;
  for (std::size_t i = 0; i < path.size(); ++i) {
    haptics::DeviceState device;
    device.position = path[i];
    if (i + 1 < path.size()) device.velocity = (path[i + 1] - path[i]) / kPeriod;
    run.prepare(device.position, device.velocity);
    const hrtc_service::ProbeOutput refined = run.cycle(hrtc_service::RefineLimit{}).probes[0];
    constexpr bool kSurfaceChanged = false;  // the full mesh never changes
    const haptics::ProxyResult& full_result = proxy.step(device.position, kPeriod, full, kSurfaceChanged);
    const Vec3d force = renderer.step(full_result, device, impedance, 0, kPeriod).force;

    ++outcome.cycles;
    const bool is_exact = (refined.status & session::kExact) != 0;
    const bool touches = full_result.in_contact || (refined.status & session::kInContact) != 0;
    if (touches) ++outcome.contact_cycles;
    if (is_exact && was_exact) {
      ++outcome.compared_cycles;
      if (touches) ++outcome.compared_contact_cycles;
      if (!same_bits(refined.force, force) || !same_bits(refined.proxy, full_result.proxy)) {
        ++outcome.different_cycles;
        outcome.max_force_error = std::max(outcome.max_force_error, (hrtc_service::vec(refined.force) - force).norm());
      }
    } else {
      proxy = run.haptic().proxy(0);
      renderer = run.haptic().renderer(0);
    }
    was_exact = is_exact;
  }
  outcome.regions_received = run.loader().figures().regions_received;
  outcome.regions_coarsened = run.loader().figures().regions_coarsened;
  return outcome;
}

void compare(const Settings& settings, LoadedModel& subject, Report& report) {
  std::fprintf(stderr, "making the path\n");
  const std::vector<Vec3d> path =
      touch_path(subject, {settings.radius, settings.depth, settings.speed, kPeriod, settings.cycles, settings.seed});
  std::fprintf(stderr, "following and tapping\n");
  const Comparison outcome = compare(subject, settings, path);
  const auto figure = [&](const char* what, std::uint64_t value) {
    report.add_value(what, {"cycles of the path", outcome.cycles}, "", static_cast<double>(value));
  };
  figure("cycles of following and tapping", outcome.cycles);
  figure("cycles in contact", outcome.contact_cycles);
  figure("regions received", outcome.regions_received);
  figure("regions coarsened to free their slots", outcome.regions_coarsened);
  report.add_value("max difference of the forces", {"compared cycles", outcome.compared_cycles}, "N",
                   outcome.max_force_error);
  report.add_at_least(
      "exact cycles that follow an exact cycle", {"contact cycles", outcome.contact_cycles}, "%",
      100.0 * static_cast<double>(outcome.compared_contact_cycles) / static_cast<double>(outcome.contact_cycles), 99);
  report.add_at_most("force or proxy differs in at least one bit", {"compared cycles", outcome.compared_cycles},
                     "cycles", static_cast<double>(outcome.different_cycles), 0);
}

void move_at_random(const Settings& settings, Report& report) {
  using namespace haptics::testing;
  const std::vector<MotionScene> scenes = motion_scenes();
  std::uint64_t passed = 0, motions = 0, motions_with_space = 0;
  double deepest = 0;
  for (const MotionScene& scene : scenes) {
    std::fprintf(stderr, "random motions: %s\n", scene.name.c_str());
    std::uint64_t scene_motions = 0, contacts = 0, pushed = 0, crushed = 0;
    for (const double friction : {0.0, 0.6}) {
      const MotionResult result =
          run_motions(scene, settings.motions / (2 * scenes.size()) + 1, friction, settings.seed);
      scene_motions += result.motions;
      contacts += result.contacts;
      pushed += result.pushed;
      crushed += result.crushed;
      passed += result.passed;
      if (!scene.may_crush) deepest = std::max(deepest, result.deepest);
      if (result.passed > 0)
        report.add_note(scene.name + ", friction " + std::to_string(friction) + ": " + result.what);
    }
    motions += scene_motions;
    if (!scene.may_crush) motions_with_space += scene_motions;
    const Population in_scene{"random motions, " + scene.name, scene_motions};
    report.add_value("contacts", in_scene, "", static_cast<double>(contacts));
    if (pushed > 0) report.add_value("contacts with a moving body", in_scene, "", static_cast<double>(pushed));
    if (crushed > 0) report.add_value("motions without room for the proxy", in_scene, "", static_cast<double>(crushed));
  }
  report.add_value("random motions", {"scenes", scenes.size()}, "", static_cast<double>(motions));
  report.add_value("overlap of proxy and body, max", {"random motions, scenes that leave room", motions_with_space},
                   "um", deepest * 1e6);
  report.add_at_most("proxies that passed into a body", {"random motions", motions}, "", static_cast<double>(passed),
                     0);
}

void add_friction_rows(const Settings& settings, Report& report) {
  using namespace haptics::testing;
  constexpr double kSpeed = 0.3;         // m/s, max
  constexpr double kSmallRadius = 0.01;  // m; inside a sphere of this radius the tip's path is strongly curved
  double stick_error = 0, slip_error = 0, small_hollow_error = 0, max_stick_ratio = 0, max_return_ratio = 0;
  std::uint64_t stick_cycles = 0, slip_cycles = 0, small_hollow_cycles = 0, returns = 0;
  for (const double radius : {kSmallRadius, 0.02, 0.05, 100.0})
    for (const bool hollow : {false, true})
      for (const auto& [static_friction, dynamic_friction] : {std::pair{0.5, 0.3}, {0.8, 0.75}, {0.2, 0.2}}) {
        const FrictionResult result = run_friction(AnalyticSphere{radius, hollow}, static_friction, dynamic_friction,
                                                   kSpeed, settings.friction_cycles, settings.seed);
        stick_error = std::max(stick_error, result.stick_error);
        const bool is_small_hollow = radius == kSmallRadius && hollow;
        stick_cycles += result.sticking;
        returns += result.stuck_again;
        (is_small_hollow ? small_hollow_cycles : slip_cycles) += result.slipping;
        double& error = is_small_hollow ? small_hollow_error : slip_error;
        error = std::max(error, result.slip_error);
        max_stick_ratio = std::max(max_stick_ratio, result.max_stuck);
        max_return_ratio = std::max(max_return_ratio, result.max_return);
      }
  report.add_value("friction error in slip, max, inside a sphere of radius 10 mm", {"slip cycles", small_hollow_cycles},
                   "%", 100 * small_hollow_error);
  report.add_value("max tangential force divided by the static friction limit", {"stick cycles", stick_cycles}, "%",
                   100 * max_stick_ratio);
  report.add_value("max tangential force divided by the static friction limit", {"transitions to stick", returns}, "%",
                   100 * max_return_ratio);
  report.add_at_most("force outside the static cone, max", {"stick cycles", stick_cycles}, "%", 100 * stick_error, 1);
  report.add_at_most("friction error in slip, max of the other surfaces", {"slip cycles", slip_cycles}, "%",
                     100 * slip_error, 1);
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
  report.set_virtual_time(true);
  compare(settings, subject, report);
  move_at_random(settings, report);
  add_friction_rows(settings, report);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"fidelity",
                         "Forces on a refined mesh compared with those on the full mesh; random motions; friction",
                         "20,000 cycles, 10^5 motions, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--cycles", settings.cycles, "cycles of following and tapping")->check(CLI::Range(2000u, 100000000u));
  app.add_option("--motions", settings.motions, "random motions, sum over all scenes");
  app.add_option("--speed", settings.speed, "speed along the surface, m/s")
      ->check(tactus::wire::finite_range(0.001, 2.0));
  app.add_option("--radius", settings.radius, "radius of the tip, m")->check(tactus::wire::finite_range(0.0005, 0.01));
  app.add_option("--pool-share", settings.pool_share, "size of the pool, as a share of the model's records")
      ->check(tactus::wire::finite_range(0.01, 1.0));
  app.add_option("--seed", settings.seed, "seed of path and motions");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.cycles = std::min(settings.cycles, 20'000u);
      settings.motions = std::min<std::uint64_t>(settings.motions, 100'000);
      settings.friction_cycles = 20'000;
    }
    return tactus::bench::run(settings);
  });
}
