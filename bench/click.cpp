// Is refinement felt? At every pose the force on the mesh as refinement has just left it is compared with the force
// that the same proxy, from the same state, would have had on the mesh before: the difference is refinement's doing
// alone.
//
// Regions come late on purpose, and each cycle may refine little, so that surfaces change under the tip. Virtual time.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/controller.hpp"
#include "bench/figures.hpp"
#include "bench/models.hpp"
#include "bench/session_run.hpp"
#include "bench/touch_path.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr double kPeriod = 0.001;  // s
constexpr double kLimit = 0.05;    // N a ms

struct Settings {
  std::string model, json;
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
  Samples steps,
      plain_steps;  // N a ms: of refinement where it moved the proxy; of the force from one cycle to the next
  std::uint64_t contact = 0, exact = 0, over = 0;
  double worst = 0;
};

Outcome touch(const LoadedModel& subject, const Settings& settings, const std::vector<Vec3d>& path) {
  SessionSettings session;
  session.pool = spm::PoolSettings::for_slots(slots_for(subject.model.summary, settings.pool_share, 8192));
  session.cycle.radius = session.loader.radius = settings.radius;
  session.material = settings.material;
  session.delay_cycles = settings.delay;
  SessionRun run{subject.model, subject.model.summary.metres_per_unit, session};
  run.settle(path.front());
  const haptics::Feel feel{settings.material.stiffness, settings.material.damping};
  Outcome outcome;
  Vec3d last = Vec3d::Zero();
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    haptics::DeviceState device;
    device.position = path[i];
    device.velocity = (path[i + 1] - path[i]) / kPeriod;
    run.prepare(device.position, device.velocity);
    haptics::Proxy proxy = run.haptic().proxy(0);
    haptics::ForceRenderer renderer = run.haptic().renderer(0);
    const Vec3d before =
        renderer.step(proxy.step(device.position, kPeriod, run.haptic().surface(0), false), device, feel, 0, kPeriod)
            .force;
    const hrtc_service::ProbeOutput& probe = run.cycle(spm::Budget{settings.budget}).probes[0];
    const Vec3d now = hrtc_service::vec(probe.force);
    const double step = (now - before).norm();
    outcome.worst = std::max(outcome.worst, step);
    if (step > kLimit) ++outcome.over;
    if (step > 0) outcome.steps.add(step);
    if (i > 0) outcome.plain_steps.add((now - last).norm());
    last = now;
    if ((probe.status & session::kInContact) == 0) continue;
    ++outcome.contact;
    if ((probe.status & session::kExact) != 0) ++outcome.exact;
  }
  return outcome;
}

int run(const Settings& settings) {
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
  Report report{{"click", subject.name, summary.digest, summary.faces, text}};
  report.row("force step by refinement", "where there is any", "N/ms", outcome.steps);
  report.row("force step, whatever caused it", "all cycles", "N/ms", outcome.plain_steps);
  report.figure("in contact", "all cycles", "", static_cast<double>(outcome.contact));
  report.figure("exact", "cycles in contact", "%",
                100.0 * static_cast<double>(outcome.exact) / static_cast<double>(outcome.contact));
  report.figure("over the limit", "all cycles", "", static_cast<double>(outcome.over));
  report.at_least("cycles in which refinement changed the force", "all", "", static_cast<double>(outcome.steps.size()),
                  20);
  report.at_most("greatest force step by refinement", "all cycles", "N/ms", outcome.worst, kLimit);
  return report.finish(settings.json);
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  CLI::App app{"The force step that refinement causes under a tip in contact"};
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
  app.add_option("--json", settings.json, "the figures as JSON");
  app.add_flag("--quick", settings.quick, "10,000 cycles on 200,000 faces, for CI");
  return tactus::bench::bench_main(app, "tactus-bench-click", argc, argv, [&] {
    if (settings.quick) {
      settings.cycles = std::min(settings.cycles, 10'000u);
      settings.faces = std::min(settings.faces, 200'000u);
    }
    return tactus::bench::run(settings);
  });
}
