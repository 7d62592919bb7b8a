// Is refinement felt? At every pose the force on the mesh as refinement has just left it is compared with the force
// that the same proxy, from the same state, would have had on the mesh before: the difference is refinement's doing
// alone. Ramps go on for some time after; so the force that is felt is also followed from one cycle to the next, and
// what it does beyond what the hand's motion explains is refinement's, too.
//
// Regions come late on purpose, and each cycle may refine little, so that surfaces change under the tip. Virtual time.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/hrtc_model.hpp"
#include "bench/models.hpp"
#include "bench/session_run.hpp"
#include "bench/touch_path.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr double kPeriod = 0.001;  // s
constexpr double kLimit = 0.05;    // N a ms

struct Settings {
  std::string model;
  std::uint32_t faces = 10'000'000;
  std::uint32_t cycles = 100'000;
  double radius = 0.0015;  // m
  double speed = 0.1;      // m/s
  double depth = 0.0005;   // m
  double pool_share = 0.25;
  session::Material material{2000, 1, 0.5, 0.4};
  std::uint32_t delay = 100;    // cycles that demands and records are under way, each
  std::uint32_t budget = 2000;  // units of spm::Budget in a cycle
  std::uint64_t seed = 1;
  bool quick = false;
};

struct Outcome {
  // N a ms: of refinement, as felt and as it would be without a ramp, where there is any; of it and its ramp in every
  // cycle in which no limit acts on the force; of the force from one cycle to the next.
  Samples steps, unramped, with_ramps, all_steps;
  Samples ramps;  // ms
  std::uint64_t contact = 0, exact = 0, over = 0;
};

/// What spring and damper alone make of where a proxy is.
Vec3d plain_force(const haptics::ProxyResult& proxy, const haptics::DeviceState& device, const haptics::Feel& feel) {
  haptics::ForceSettings none;
  none.soft_start = 0;
  none.max_force = none.max_slew = 1e9;
  haptics::DeviceSpec spec;
  spec.max_force = 1e9;
  return haptics::ForceRenderer{none, spec}.step(proxy, device, feel, 0, kPeriod).force;
}

/// Of a felt force that has changed by `felt`, what is not explained by the hand's motion, which without any ramp would
/// have changed it by `moved`: all of that, none, or its part along some directions, as where a ramp must not pull.
double unexplained(const Vec3d& felt, const Vec3d& moved) {
  return std::max(0.0, (felt - moved / 2).norm() - moved.norm() / 2);
}

Outcome touch(const LoadedModel& subject, const Settings& settings, const std::vector<Vec3d>& path) {
  SessionSettings session;
  session.pool = spm::PoolSettings::for_slots(slots_for(subject.model.summary, settings.pool_share, 8192));
  session.cycle.radius = session.loader.radius = settings.radius;
  session.material = settings.material;
  session.delay_cycles = settings.delay;
  SessionRun run{subject.model, subject.model.summary.metres_per_unit, session};
  run.settle(path.front());
  const haptics::Feel feel{settings.material.stiffness, settings.material.damping};
  constexpr std::uint32_t kLimits = session::kForceSaturated | session::kFault;
  Outcome outcome;
  Vec3d last = Vec3d::Zero(), last_plain = Vec3d::Zero();
  double ramped = 0;
  bool limited = true;
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    haptics::DeviceState device;
    device.position = path[i];
    device.velocity = (path[i + 1] - path[i]) / kPeriod;
    run.prepare(device.position, device.velocity);
    haptics::Proxy proxy = run.haptic().proxy(0);
    haptics::ForceRenderer renderer = run.haptic().renderer(0);
    const haptics::ProxyResult& unchanged = proxy.step(device.position, kPeriod, run.haptic().surface(0), false);
    const haptics::ForceResult& before = renderer.step(unchanged, device, feel, 0, kPeriod);
    const hrtc_service::ProbeOutput& probe = run.cycle(spm::Budget{settings.budget}).probes[0];
    const Vec3d now = hrtc_service::vec(probe.force);
    const Vec3d plain = plain_force(run.haptic().proxy(0).last(), device, feel);
    const Vec3d plain_before = plain_force(unchanged, device, feel);
    const double step = (now - before.force).norm(), unramped = (plain - plain_before).norm();
    if (std::max(step, unramped) > 0) {
      outcome.steps.add(step);
      outcome.unramped.add(unramped);
    }
    if (step > kLimit) ++outcome.over;
    const bool was_limited = limited;
    limited = (probe.status & kLimits) != 0 || (now - last).norm() > 0.99 * session.cycle.force.max_slew * kPeriod ||
              static_cast<double>(i) * kPeriod < session.cycle.force.soft_start;
    if (!limited && !was_limited) outcome.with_ramps.add(unexplained(now - last, plain_before - last_plain));
    if (i > 0) outcome.all_steps.add((now - last).norm());
    last = now;
    last_plain = plain;
    const bool ramps = !limited && (now - plain).norm() > kLimit;
    if (!ramps && ramped > 0) outcome.ramps.add(ramped);
    ramped = ramps ? ramped + 1 : 0;
    if ((probe.status & session::kInContact) == 0) continue;
    ++outcome.contact;
    if ((probe.status & session::kExact) != 0) ++outcome.exact;
  }
  return outcome;
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  LoadedModel subject = load_model(settings.model, settings.faces);
  if (settings.model.empty()) scale_to_edge(subject, kHandEdge);
  const spm::ModelSummary& summary = subject.model.summary;
  std::fprintf(stderr, "making the path\n");
  const std::vector<Vec3d> path =
      touch_path(subject, {settings.radius, settings.depth, settings.speed, kPeriod, settings.cycles, settings.seed});
  std::fprintf(stderr, "following and tapping\n");
  const Outcome outcome = touch(subject, settings, path);

  char text[256];
  std::snprintf(
      text, sizeof text,
      "radius %g mm, %g cm/s, %g mm deep, friction %g and %g, %g N/m, pool %g of the model, %u cycles each way, "
      "budget %u, seed %llu",
      settings.radius * 1e3, settings.speed * 1e2, settings.depth * 1e3, settings.material.static_friction,
      settings.material.dynamic_friction, settings.material.stiffness, settings.pool_share, settings.delay,
      settings.budget, static_cast<unsigned long long>(settings.seed));
  Report report{{subject.name, summary.digest, summary.faces, text}};
  report.row("force step by refinement", "where there is any", "N/ms", outcome.steps);
  report.row("  without a ramp", "the same", "N/ms", outcome.unramped);
  report.row("force step not by the hand", "no limit acts", "N/ms", outcome.with_ramps);
  report.row("ramps: 0.05 N off at least", "all", "ms", outcome.ramps);
  report.row("force step, whatever caused it", "all cycles", "N/ms", outcome.all_steps);
  report.figure("in contact", "all cycles", "", static_cast<double>(outcome.contact));
  report.figure("exact", "cycles in contact", "%",
                100.0 * static_cast<double>(outcome.exact) / static_cast<double>(outcome.contact));
  report.figure("over the limit", "all cycles", "", static_cast<double>(outcome.over));
  report.at_least("cycles in which refinement changed the force", "all", "", static_cast<double>(outcome.steps.size()),
                  20);
  report.at_most("greatest force step by refinement", {"all cycles", outcome.steps.size()}, "N/ms", outcome.steps.max(),
                 kLimit);
  report.at_most("greatest force step not by the hand", {"no limit acts", outcome.with_ramps.size()}, "N/ms",
                 outcome.with_ramps.max(), kLimit);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"click", "The force step that refinement causes under a tip in contact",
                         "10,000 cycles on 200,000 faces, for CI"};
  app.add_option("--model", settings.model, "model file of any kind, or .spm (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--cycles", settings.cycles, "of following and tapping")->check(CLI::Range(2000u, 100000000u));
  app.add_option("--speed", settings.speed, "along the surface, m/s")->check(CLI::Range(0.001, 2.0));
  app.add_option("--radius", settings.radius, "of the tip, m")->check(CLI::Range(0.0005, 0.01));
  app.add_option("--pool-share", settings.pool_share, "pool, as a share of the model's records")
      ->check(CLI::Range(0.01, 1.0));
  app.add_option("--delay", settings.delay, "cycles that demands and records are under way, each");
  app.add_option("--budget", settings.budget, "of a cycle")->check(CLI::Range(100u, 1u << 20));
  app.add_option("--seed", settings.seed, "of the path");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.cycles = std::min(settings.cycles, 10'000u);
      settings.faces = std::min(settings.faces, 200'000u);
    }
    return tactus::bench::run(settings);
  });
}
