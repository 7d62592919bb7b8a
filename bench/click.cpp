// Measures the force steps that refinement causes.
//
// In each cycle, the force on the refined mesh is compared with the force that the same proxy, in the same state, has
// on the mesh before refinement. The difference is caused by refinement alone. A surface ramp spreads it over later
// cycles. Therefore the change of the published force between cycles is measured, too. The part of this change that the
// hand's motion does not explain is also caused by refinement.
//
// Regions are delayed, and each cycle may refine little, so that the surface changes under the tip. Virtual time.
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
constexpr double kMaxStep = 0.05;  // N/ms

struct Settings {
  std::string model;
  std::uint32_t faces = 10'000'000;
  std::uint32_t cycles = 100'000;
  double radius = 0.0015;  // m, of the tip
  double speed = 0.1;      // m/s, of the tip
  double depth = 0.0005;   // m, overlap of tip and surface
  double pool_share = 0.25;
  session::Material material{2000, 1, 0.5, 0.4};
  std::uint32_t delay = 100;    // cycles between publishing and receiving a demand or record
  std::uint32_t budget = 2000;  // units of spm::Budget for each cycle
  std::uint64_t seed = 1;
  bool quick = false;
};

struct Outcome {
  Samples steps;           // N/ms, of the published force, caused by refinement; cycles in which refinement changes it
  Samples unramped_steps;  // N/ms, in the same cycles, without a surface ramp
  Samples unexplained;     // N/ms, change between cycles that the hand does not explain, where no force limit acts
  Samples changes;         // N/ms, between cycles
  Samples ramps;           // ms, duration
  std::uint64_t contact_cycles = 0, exact_cycles = 0, cycles_over_max = 0;
};

/// The force of spring and damper alone, without ramps and limits.
Vec3d unlimited_force(const haptics::ProxyResult& proxy, const haptics::DeviceState& device,
                      const haptics::ContactImpedance& impedance) {
  haptics::ForceSettings no_limits;
  no_limits.soft_start = 0;
  no_limits.max_force = no_limits.max_slew = 1e9;
  haptics::DeviceSpec spec;
  spec.max_force = 1e9;
  return haptics::ForceRenderer{no_limits, spec}.step(proxy, device, impedance, 0, kPeriod).force;
}

/// Returns the part of a force change that the hand's motion does not explain, N. Without a ramp, the motion causes
/// `by_hand`. A ramp may pass all of `by_hand`, nothing, or its components along some directions. All these vectors
/// end in the sphere whose diameter is the vector `by_hand`.
double unexplained(const Vec3d& change, const Vec3d& by_hand) {
  return std::max(0.0, (change - by_hand / 2).norm() - by_hand.norm() / 2);
}

Outcome touch(const LoadedModel& subject, const Settings& settings, const std::vector<Vec3d>& path) {
  SessionSettings session;
  session.pool = spm::PoolSettings::for_slots(slots_for(subject.model.summary, settings.pool_share, 8192));
  session.cycle.radius = session.loader.radius = settings.radius;
  session.material = settings.material;
  session.delay_cycles = settings.delay;
  SessionRun run{subject.model, subject.model.summary.metres_per_unit, session};
  run.settle(path.front());
  const haptics::ContactImpedance impedance{settings.material.stiffness, settings.material.damping};
  constexpr std::uint32_t kLimitBits = session::kForceSaturated | session::kFault;
  Outcome outcome;
  Vec3d previous_force = Vec3d::Zero(), previous_unlimited = Vec3d::Zero();
  double ramp_cycles = 0;
  bool is_limited = true;
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    haptics::DeviceState device;
    device.position = path[i];
    device.velocity = (path[i + 1] - path[i]) / kPeriod;
    run.prepare(device.position, device.velocity);
    haptics::Proxy proxy = run.haptic().proxy(0);
    haptics::ForceRenderer renderer = run.haptic().renderer(0);
    const haptics::ProxyResult& unchanged = proxy.step(device.position, kPeriod, run.haptic().surface(0), false);
    const haptics::ForceResult& before = renderer.step(unchanged, device, impedance, 0, kPeriod);
    const hrtc_service::ProbeOutput& probe = run.cycle(spm::Budget{settings.budget}).probes[0];
    const Vec3d force = hrtc_service::vec(probe.force);
    const Vec3d unlimited = unlimited_force(run.haptic().proxy(0).last(), device, impedance);
    const Vec3d unlimited_before = unlimited_force(unchanged, device, impedance);
    const double step = (force - before.force).norm(), unramped = (unlimited - unlimited_before).norm();
    if (std::max(step, unramped) > 0) {
      outcome.steps.add(step);
      outcome.unramped_steps.add(unramped);
    }
    if (step > kMaxStep) ++outcome.cycles_over_max;
    const bool was_limited = is_limited;
    is_limited = (probe.status & kLimitBits) != 0 ||
                 (force - previous_force).norm() > 0.99 * session.cycle.force.max_slew * kPeriod ||
                 static_cast<double>(i) * kPeriod < session.cycle.force.soft_start;
    if (!is_limited && !was_limited)
      outcome.unexplained.add(unexplained(force - previous_force, unlimited_before - previous_unlimited));
    if (i > 0) outcome.changes.add((force - previous_force).norm());
    previous_force = force;
    previous_unlimited = unlimited;
    const bool is_ramping = !is_limited && (force - unlimited).norm() > kMaxStep;
    if (!is_ramping && ramp_cycles > 0) outcome.ramps.add(ramp_cycles);
    ramp_cycles = is_ramping ? ramp_cycles + 1 : 0;
    if ((probe.status & session::kInContact) == 0) continue;
    ++outcome.contact_cycles;
    if ((probe.status & session::kExact) != 0) ++outcome.exact_cycles;
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
  std::snprintf(text, sizeof text,
                "radius %g mm, %g cm/s, %g mm deep, friction %g and %g, %g N/m, pool %g of the model, delay %u cycles, "
                "budget %u, seed %llu",
                settings.radius * 1e3, settings.speed * 1e2, settings.depth * 1e3, settings.material.static_friction,
                settings.material.dynamic_friction, settings.material.stiffness, settings.pool_share, settings.delay,
                settings.budget, static_cast<unsigned long long>(settings.seed));
  Report report{{subject.name, summary.digest, summary.faces, text}};
  report.set_virtual_time(true);
  const std::string with_step = "cycles with such a step", unlimited = "cycles without a force limit";
  const Population all{"all cycles", path.size() - 1};  // touch() needs the pose after each cycle
  report.add_percentiles("force step by refinement", with_step, "N/ms", outcome.steps);
  report.add_percentiles("force step by refinement, without ramp", with_step, "N/ms", outcome.unramped_steps);
  report.add_percentiles("force change that the hand does not explain", unlimited, "N/ms", outcome.unexplained);
  report.add_percentiles("duration of a ramp of over 0.05 N", "ramps", "ms", outcome.ramps);
  report.add_percentiles("force change between cycles", "all cycles", "N/ms", outcome.changes);
  report.add_value("cycles in contact", all, "", static_cast<double>(outcome.contact_cycles));
  report.add_value("exact", {"contact cycles", outcome.contact_cycles}, "%",
                   100.0 * static_cast<double>(outcome.exact_cycles) / static_cast<double>(outcome.contact_cycles));
  report.add_value("cycles with a step by refinement over 0.05 N/ms", all, "",
                   static_cast<double>(outcome.cycles_over_max));
  report.add_at_least("cycles in which refinement changes the force", all, "",
                      static_cast<double>(outcome.steps.size()), 20);
  report.add_at_most("max force step by refinement", {with_step, outcome.steps.size()}, "N/ms", outcome.steps.max(),
                     kMaxStep);
  report.add_at_most("max force change not explained by the hand", {unlimited, outcome.unexplained.size()}, "N/ms",
                     outcome.unexplained.max(), kMaxStep);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"click", "Force steps that refinement causes under a tip in contact",
                         "10,000 cycles on 200,000 faces, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--cycles", settings.cycles, "cycles of following and tapping")->check(CLI::Range(2000u, 100000000u));
  app.add_option("--speed", settings.speed, "speed along the surface, m/s")
      ->check(tactus::wire::finite_range(0.001, 2.0));
  app.add_option("--radius", settings.radius, "radius of the tip, m")->check(tactus::wire::finite_range(0.0005, 0.01));
  app.add_option("--pool-share", settings.pool_share, "size of the pool, as a share of the model's records")
      ->check(tactus::wire::finite_range(0.01, 1.0));
  app.add_option("--delay", settings.delay, "cycles between publishing and receiving a demand or record");
  app.add_option("--budget", settings.budget, "budget of a cycle, units of spm::Budget")
      ->check(CLI::Range(100u, 1u << 20));
  app.add_option("--seed", settings.seed, "seed of the path");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.cycles = std::min(settings.cycles, 10'000u);
      settings.faces = std::min(settings.faces, 200'000u);
    }
    return tactus::bench::run(settings);
  });
}
