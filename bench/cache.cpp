// Measures the benefit of loaded regions that no probe wants, by size of the pool. Without them, the loaded front
// equals the refined front (the paper's figure 5b). The largest pool holds the whole model (figure 5d).
//
// A tip follows a surface path and returns on it, so that it touches every region twice. Host, loader and cycle are
// those of the programs. Refinement has no budget. T_L is the time of the haptic thread for arrivals. Loader time is
// the time of the thread that decodes records.
//
// Time is virtual, so every repeat loads the same regions in the same order. For each region, the minimum time over the
// repeats excludes the load of the machine. With these minima the benchmark tests whether loader time is linear in
// records. It tests this for each pool alone, because slots that are farther apart in memory make a record slower.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <iterator>
#include <stdexcept>
#include <utility>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/hrtc_model.hpp"
#include "bench/models.hpp"
#include "bench/session_run.hpp"
#include "bench/surface_path.hpp"
#include "spm/fcl/fixed_mesh.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;

constexpr double kPeriod = 0.001;  // s

struct Settings {
  std::string model;
  std::uint32_t faces = 1'000'000;
  double seconds = 60;    // path and return
  double radius = 0.003;  // m, of the tip
  double speed = 0.05;    // m/s, of the tip
  double depth = 0.0002;  // m, overlap of tip and surface
  std::uint64_t seed = 1;
  std::uint32_t repeats = 7;
  bool quick = false;
};

struct PoolCase {
  const char* name;
  double pool_share;  // of the model's records
};
constexpr PoolCase kPools[] = {{"1/64 of the model", 1.0 / 64},
                               {"1/16 of the model", 1.0 / 16},
                               {"1/4 of the model", 0.25},
                               {"whole model (figure 5d)", 1}};

struct Outcome {
  Samples load_us, gateway_us, records;  // of each cycle
  Samples slots_per_record;              // slots in use for each shown record
  std::vector<RegionLoad> loads;
  std::uint64_t records_received = 0, received_again = 0, contact_cycles = 0, exact_cycles = 0;
  hrtc_service::LoaderFigures figures;
};

/// Line of least squares through (records, time) of the loads.
struct Fit {
  double intercept = 0, slope = 0, r2 = 0;  // us, us for each record
};
Fit fit(const std::vector<RegionLoad>& loads) {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  for (const RegionLoad& load : loads) {
    const auto records = static_cast<double>(load.records);
    n += 1;
    x += records;
    y += load.us;
    xx += records * records;
    xy += records * load.us;
    yy += load.us * load.us;
  }
  const double variance_x = n * xx - x * x, variance_y = n * yy - y * y, covariance = n * xy - x * y;
  if (variance_x <= 0 || variance_y <= 0) return {};
  return {(y - covariance / variance_x * x) / n, covariance / variance_x,
          covariance * covariance / (variance_x * variance_y)};
}

Outcome run_pool(const spm::Model& model, const Settings& settings, const PoolCase& pool,
                 const std::vector<Vec3d>& path, const Vec3d& away) {
  SessionSettings session;
  session.pool = spm::PoolSettings::for_slots(slots_for(model.summary, pool.pool_share, 8192));
  session.cycle.radius = session.loader.radius = settings.radius;
  const double scale = model.summary.metres_per_unit;
  SessionRun run{model, scale, session};
  run.settle(away * scale);
  Outcome outcome;
  for (std::size_t i = 0; i < path.size(); ++i) {
    run.prepare(path[i] * scale,
                i + 1 < path.size() ? Vec3d{(path[i + 1] - path[i]) * scale / kPeriod} : Vec3d{Vec3d::Zero()});
    const hrtc_service::CycleResult& result = run.cycle(spm::Budget{1u << 20});
    std::uint64_t records = 0;
    for (const RegionLoad& load : run.loads()) {
      records += load.records;
      outcome.loads.push_back(load);
    }
    outcome.load_us.add(result.costs.load * 1e-3);
    outcome.gateway_us.add(run.gateway_us());
    outcome.records.add(static_cast<double>(records));
    if ((result.probes[0].status & session::kInContact) != 0) {
      ++outcome.contact_cycles;
      if ((result.probes[0].status & session::kExact) != 0) ++outcome.exact_cycles;
    }
    constexpr std::size_t kCountPeriod = 100;  // cycles
    if (i % kCountPeriod != 0) continue;
    const spm::ForestCounters& counters = run.haptic().objects().front()->forest->counters();
    const auto shown = static_cast<double>(counters.splits - counters.collapses);
    const std::uint32_t base = slots_for(model.summary, 0);
    if (shown > 0) outcome.slots_per_record.add((run.loader().figures().slots_used - base) / shown);
  }
  outcome.figures = run.loader().figures();
  outcome.records_received = outcome.figures.records_received;
  outcome.received_again = outcome.figures.records_received_again;
  return outcome;
}

/// Replaces the time of each load by the minimum of both runs. Throws std::runtime_error if the runs differ.
void merge_min(std::vector<RegionLoad>& loads, const std::vector<RegionLoad>& repeated) {
  if (repeated.size() != loads.size()) throw std::runtime_error("a repeat loaded other regions");
  for (std::size_t i = 0; i < loads.size(); ++i) {
    if (repeated[i].records != loads[i].records) throw std::runtime_error("a repeat loaded other records");
    loads[i].us = std::min(loads[i].us, repeated[i].us);
  }
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  LoadedModel subject = load_model(settings.model, settings.faces);
  if (settings.model.empty()) scale_to_edge(subject, kHandEdge);
  const spm::ModelSummary& summary = subject.model.summary;
  const double unit = summary.metres_per_unit;
  std::fprintf(stderr, "making the path\n");
  const spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
  const PathSettings path_settings{settings.radius / unit, settings.depth / unit, settings.speed * kPeriod / unit,
                                   static_cast<std::uint32_t>(settings.seconds / kPeriod / 2), settings.seed};
  std::vector<Vec3d> path = surface_path(subject.model.positions, subject.finest, path_settings,
                                         [&](const Vec3d& p) { return finest.distance(p); });
  path.insert(path.end(), path.rbegin(), path.rend());
  const Vec3d away = Eigen::Map<const spm::Vec3f>(summary.bounds_max.data()).cast<double>() +
                     Vec3d::Constant(3 * model_length(summary) / unit);

  char text[256];
  std::snprintf(text, sizeof text, "radius %g mm, %g cm/s, %g s with return, path seed %llu", settings.radius * 1e3,
                settings.speed * 1e2, settings.seconds, static_cast<unsigned long long>(settings.seed));
  Report report{{subject.name, summary.digest, summary.faces, text}};
  std::vector<Outcome> outcomes;
  for (std::uint32_t repeat = 0; repeat < settings.repeats; ++repeat)
    for (std::size_t i = 0; i < std::size(kPools); ++i) {
      std::fprintf(stderr, "%s, %u of %u\n", kPools[i].name, repeat + 1, settings.repeats);
      Outcome outcome = run_pool(subject.model, settings, kPools[i], path, away);
      if (repeat == 0)
        outcomes.push_back(std::move(outcome));
      else
        merge_min(outcomes[i].loads, outcome.loads);
    }
  for (std::size_t i = 0; i < std::size(kPools); ++i) {
    const Outcome& outcome = outcomes[i];
    const std::string pool = kPools[i].name, cycles = "cycles, " + pool;
    const Population all{cycles, outcome.load_us.size()}, loads{"regions, " + pool, outcome.loads.size()};
    report.set_virtual_time(false);
    report.add_percentiles("T_L", cycles, "us", outcome.load_us);
    report.add_percentiles("loader time", cycles, "us", outcome.gateway_us);
    report.set_virtual_time(true);
    report.add_percentiles("records received", cycles, "", outcome.records);
    report.add_percentiles("slots in use / records shown", cycles, "", outcome.slots_per_record);
    report.add_value("records received, sum", all, "", static_cast<double>(outcome.records_received));
    report.add_value(
        "received again after an eviction", {"records, " + pool, outcome.records_received}, "% of records received",
        100.0 * static_cast<double>(outcome.received_again) / static_cast<double>(outcome.records_received));
    report.add_value("regions received", all, "", static_cast<double>(outcome.figures.regions_received));
    report.add_value("regions evicted", all, "", static_cast<double>(outcome.figures.regions_evicted));
    report.add_value("regions refused by a full pool", all, "", static_cast<double>(outcome.figures.refused_full));
    report.add_value("slots in use, max", all, "", outcome.figures.slots_peak);
    report.add_value("exact", {"contact " + cycles, outcome.contact_cycles}, "%",
                     100.0 * static_cast<double>(outcome.exact_cycles) / static_cast<double>(outcome.contact_cycles));
    report.set_virtual_time(false);
    const Fit line = fit(outcome.loads);
    report.add_value("loader time, intercept of the line", loads, "us for each region", line.intercept);
    report.add_value("loader time, slope of the line", loads, "us for each record", line.slope);
    // Between the two extremes, some slots are fresh memory and others were freed just before. That spreads the times.
    const bool is_extreme = i == 0 || i + 1 == std::size(kPools);
    if (!settings.quick)
      report.add_at_least("loader time linear in records, r^2", loads, "", line.r2, is_extreme ? 0.95 : 0.9);
    report.set_virtual_time(true);
    report.add_at_least("regions loaded", all, "", static_cast<double>(outcome.loads.size()), 100);
  }
  const Outcome &smallest = outcomes.front(), &whole = outcomes.back();
  report.add_at_most("records received again", {"records, whole model", whole.records_received}, "",
                     static_cast<double>(whole.received_again), 0);
  report.add_at_most("records received, pool for the whole model / for 1/64 of it", {"cycles", path.size()}, "times",
                     static_cast<double>(whole.records_received) / static_cast<double>(smallest.records_received), 1);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "cache",
      "Benefit of loaded regions that no probe wants: T_L, loader time and records received again, by size of the pool",
      "5 s, without a bound on linearity, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--seconds", settings.seconds, "duration of path and return, s")
      ->check(tactus::wire::finite_range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "speed of the tip, m/s")->check(tactus::wire::finite_range(0.001, 2.0));
  app.add_option("--seed", settings.seed, "seed of the path");
  app.add_option("--repeats", settings.repeats, "repeats with each pool; the minimum time of each load counts")
      ->check(CLI::Range(1u, 100u));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    settings.quick = app.quick;
    if (app.quick) settings.seconds = std::min(settings.seconds, 5.0);
    return tactus::bench::run(settings);
  });
}
