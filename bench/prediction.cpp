// Measures for each strategy of prediction, by speed and round trip: the share of contact cycles whose regions arrived
// in time, and the bytes of regions that the tip never touched.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/hand_motion.hpp"
#include "bench/remote_session.hpp"

namespace tactus::bench {
namespace {

struct Settings {
  std::string model, strategy;  // empty: all strategies
  std::uint32_t faces = 1000000;
  double seconds = 10, rate_mbit = 100, pool_mib = 16;
  std::vector<double> speeds{0.05, 0.2, 0.5, 1}, round_trips_ms{0, 10, 100};
  std::uint64_t seed = 1;
  bool quick = false;
};

/// Results of one strategy at one speed and round trip.
struct Outcome {
  std::uint64_t contact_cycles = 0, hits = 0;  // hits: cycles in which all regions at the tip were at full resolution
  RemoteSession::Traffic traffic;
  [[nodiscard]] double hit_percent() const {
    return 100.0 * static_cast<double>(hits) / static_cast<double>(contact_cycles);
  }
};

Outcome run_one(const HandScaleModel& model, const std::vector<spm::Vec3d>& path, const std::vector<bool>& touching,
                const RemoteSettings& settings) {
  RemoteSession session{model.subject.model, settings};
  session.start();
  Outcome outcome;
  for (std::size_t i = 0; i < path.size(); ++i) {
    session.step(path[i]);
    if (!touching[i]) continue;
    ++outcome.contact_cycles;
    outcome.hits += session.forest().is_exact(session.to_model(path[i]), settings.radius / session.scale()) ? 1 : 0;
  }
  outcome.traffic = session.traffic();
  return outcome;
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "building the model\n");
  const HandScaleModel model{settings.model, settings.faces};
  const spm::ModelSummary& summary = model.subject.model.summary;
  char text[256];
  std::snprintf(
      text, sizeof text,
      "tip 3 mm, lifted a third of the time; path with curvature of up to %g Hz; %g s for each figure; pool %g MiB, %g "
      "Mbit/s, seed %llu",
      kBand, settings.seconds, settings.pool_mib, settings.rate_mbit, static_cast<unsigned long long>(settings.seed));
  Report report{{model.subject.name, summary.digest, summary.faces, text}};
  report.set_virtual_time(true);

  RemoteSettings remote;
  remote.pool = spm::PoolSettings::for_bytes(static_cast<std::uint64_t>(settings.pool_mib * (1 << 20)));
  remote.radius = kTipRadius;
  remote.rate = settings.rate_mbit * 1e6;
  for (const double speed : settings.speeds) {
    const auto poses = static_cast<std::uint32_t>(settings.seconds * 1000);
    const std::vector<spm::Vec3d> path = surface_motion(model, speed, 0.005, poses, settings.seed);
    std::vector<bool> touching;
    for (const spm::Vec3d& tip : path) touching.push_back(model.distance(tip) <= kTipRadius);
    const auto contact_cycles = static_cast<std::size_t>(std::count(touching.begin(), touching.end(), true));
    for (const double round_trip_ms : settings.round_trips_ms) {
      remote.round_trip = round_trip_ms * 1e-3;
      double best = 0, shipped = 0;
      for (std::size_t s = 0; s < spm::kStrategyNames.size(); ++s) {
        const std::string strategy = spm::kStrategyNames[s];
        if (!settings.strategy.empty() && strategy != settings.strategy) continue;
        remote.loader.strategy = static_cast<spm::Strategy>(s);
        const Outcome outcome = run_one(model, path, touching, remote);
        char name[96];
        std::snprintf(name, sizeof name, "%g m/s, %g ms: %s", speed, round_trip_ms, strategy.c_str());
        std::fprintf(stderr, "%-32s hits %8.4f %%, received %7.2f MB, never touched %7.2f MB\n", name,
                     outcome.hit_percent(), static_cast<double>(outcome.traffic.bytes) / 1e6,
                     static_cast<double>(outcome.traffic.unused_bytes) / 1e6);
        report.add_value(name + std::string{", exact contact cycles divided by contact cycles"},
                         {"contact cycles", outcome.contact_cycles}, "%", outcome.hit_percent());
        report.add_value(name + std::string{", regions received"}, {"arrivals of regions", outcome.traffic.regions},
                         "MB", static_cast<double>(outcome.traffic.bytes) / 1e6);
        report.add_value(name + std::string{", regions received and never touched"},
                         {"arrivals of regions", outcome.traffic.regions}, "MB",
                         static_cast<double>(outcome.traffic.unused_bytes) / 1e6);
        (strategy == "mixture" ? shipped : best) = std::max(strategy == "mixture" ? 0 : best, outcome.hit_percent());
      }
      if (!settings.strategy.empty()) continue;
      char name[112];
      std::snprintf(name, sizeof name, "%g m/s, %g ms: share of exact contact cycles, mixture minus best other", speed,
                    round_trip_ms);
      report.add_at_least(name, {"contact cycles", contact_cycles}, "%", shipped - best, -2);
    }
  }
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"prediction",
                         "Measures the share of exact contact cycles and the bytes received in vain, by strategy of "
                         "prediction, speed and round trip",
                         "moves for 3 s on 200,000 faces, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 50000000u));
  app.add_option("--seconds", settings.seconds, "time of motion for each figure, s")
      ->check(tactus::wire::finite_range(1.0, 3600.0));
  app.add_option("--speeds", settings.speeds, "mean speeds, m/s")->check(tactus::wire::finite_range(0.001, 5.0));
  app.add_option("--round-trips", settings.round_trips_ms, "round trips, ms")
      ->check(tactus::wire::finite_range(0.0, 1000.0));
  app.add_option("--rate", settings.rate_mbit, "rate of the link, Mbit/s")->check(tactus::wire::finite_range(0.1, 1e5));
  app.add_option("--pool", settings.pool_mib, "size of the pool, MiB")->check(tactus::wire::finite_range(1.0, 1e4));
  app.add_option("--strategy", settings.strategy, "measures only this strategy")
      ->check(CLI::IsMember(
          std::vector<std::string>(tactus::spm::kStrategyNames.begin(), tactus::spm::kStrategyNames.end())));
  app.add_option("--seed", settings.seed, "seed of the paths");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) {
      settings.seconds = std::min(settings.seconds, 3.0);
      settings.faces = std::min(settings.faces, 200000u);
    }
    return tactus::bench::run(settings);
  });
}
