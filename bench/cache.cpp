// What a cache is worth: from no spare room, where the loaded front is the refined one (the paper's figure 5b), to room
// for the whole model (5d).
//
// A tip goes along a surface path and back, so that all of it is met twice. The real host, loader and cycle; refinement
// without a budget. T_L is what arrivals cost the haptic thread, loader time what they cost the thread that decodes.
//
// Time is virtual, so a run that is repeated loads the same regions in the same order. Whether loading is linear in
// records is asked of each region's least time over the repeats: what else went on in the machine is no part of that.
// It is asked for each cache alone, for a record takes longer where slots are further apart in memory.
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
  double seconds = 60;    // out and back
  double radius = 0.003;  // m
  double speed = 0.05;    // m/s
  double depth = 0.0002;  // m
  std::uint64_t seed = 1;
  std::uint32_t repeats = 7;
  bool quick = false;
};

struct Level {
  const char* name;
  double pool_share;
  bool spare;  // keeps what nobody wants
};
constexpr Level kLevels[] = {{"no spare (figure 5b)", 1.0 / 16, false},
                             {"1/64 of the model", 1.0 / 64, true},
                             {"1/16 of the model", 1.0 / 16, true},
                             {"1/4 of the model", 0.25, true},
                             {"whole model (figure 5d)", 1, true}};

struct Outcome {
  Samples take, loader, records;  // us, us, records of a cycle
  Samples held_of_shown;          // slots in use for each record shown
  std::vector<RegionLoad> loads;
  std::uint64_t received = 0, twice = 0, contact = 0, exact = 0;
  hrtc_service::LoaderFigures figures;
};

/// Least squares of time over records.
struct Fit {
  double intercept = 0, slope = 0, r2 = 0;
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
  const double of_x = n * xx - x * x, of_y = n * yy - y * y, of_both = n * xy - x * y;
  if (of_x <= 0 || of_y <= 0) return {};
  return {(y - of_both / of_x * x) / n, of_both / of_x, of_both * of_both / (of_x * of_y)};
}

Outcome run_level(const spm::Model& model, const Settings& settings, const Level& level, const std::vector<Vec3d>& path,
                  const Vec3d& away) {
  SessionSettings session;
  session.pool = spm::PoolSettings::for_slots(slots_for(model.summary, level.pool_share, 8192));
  session.cycle.radius = session.loader.radius = settings.radius;
  session.loader.keep_unwanted = level.spare;
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
    outcome.take.add(result.costs.load * 1e-3);
    outcome.loader.add(run.loader_us());
    outcome.records.add(static_cast<double>(records));
    if ((result.probes[0].status & session::kInContact) != 0) {
      ++outcome.contact;
      if ((result.probes[0].status & session::kExact) != 0) ++outcome.exact;
    }
    constexpr std::size_t kLookEvery = 100;  // cycles
    if (i % kLookEvery != 0) continue;
    const spm::ForestCounters& counters = run.haptic().objects().front()->forest->counters();
    const auto shown = static_cast<double>(counters.splits - counters.collapses);
    const std::uint32_t base = slots_for(model.summary, 0);
    if (shown > 0) outcome.held_of_shown.add((run.loader().figures().slots_used - base) / shown);
  }
  outcome.figures = run.loader().figures();
  outcome.received = outcome.figures.records_received;
  outcome.twice = outcome.figures.records_returned;
  return outcome;
}

/// The least time of each.
void keep_min(std::vector<RegionLoad>& loads, const std::vector<RegionLoad>& again) {
  if (again.size() != loads.size()) throw std::runtime_error("a run that was repeated loaded other regions");
  for (std::size_t i = 0; i < loads.size(); ++i) {
    if (again[i].records != loads[i].records) throw std::runtime_error("a run that was repeated loaded other records");
    loads[i].us = std::min(loads[i].us, again[i].us);
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
                     Vec3d::Constant(3 * longest_side(summary) / unit);

  char text[256];
  std::snprintf(text, sizeof text, "radius %g mm, %g cm/s, %g s out and back, path seed %llu", settings.radius * 1e3,
                settings.speed * 1e2, settings.seconds, static_cast<unsigned long long>(settings.seed));
  Report report{{subject.name, summary.digest, summary.faces, text}};
  std::vector<Outcome> outcomes;
  for (std::uint32_t repeat = 0; repeat < settings.repeats; ++repeat)
    for (std::size_t i = 0; i < std::size(kLevels); ++i) {
      std::fprintf(stderr, "%s, %u of %u\n", kLevels[i].name, repeat + 1, settings.repeats);
      Outcome outcome = run_level(subject.model, settings, kLevels[i], path, away);
      if (repeat == 0)
        outcomes.push_back(std::move(outcome));
      else
        keep_min(outcomes[i].loads, outcome.loads);
    }
  for (std::size_t i = 0; i < std::size(kLevels); ++i) {
    const Outcome& outcome = outcomes[i];
    const std::string all = kLevels[i].name;
    report.row("T_L", all, "us", outcome.take);
    report.row("loader time", all, "us", outcome.loader);
    report.row("records received", all, "", outcome.records);
    report.row("slots held / records shown", all, "", outcome.held_of_shown);
    report.figure("records received", all, "", static_cast<double>(outcome.received));
    report.figure("received twice", all, "% of these",
                  100.0 * static_cast<double>(outcome.twice) / static_cast<double>(outcome.received));
    report.figure("regions received", all, "", static_cast<double>(outcome.figures.regions_received));
    report.figure("regions evicted", all, "", static_cast<double>(outcome.figures.regions_evicted));
    report.figure("refused, pool full", all, "", static_cast<double>(outcome.figures.refused_full));
    report.figure("most slots in use", all, "", outcome.figures.slots_peak);
    report.figure("exact, of contact cycles", all, "%",
                  100.0 * static_cast<double>(outcome.exact) / static_cast<double>(outcome.contact));
    const Fit line = fit(outcome.loads);
    report.figure("loader time, line", all, "us a region", line.intercept);
    report.figure("loader time, line", all, "us a record", line.slope);
    // In between, slots come partly fresh from memory and partly from what was just let go.
    const bool end = i == 0 || i + 1 == std::size(kLevels);
    if (!settings.quick)
      report.at_least("loader time linear in records, r^2", {all, outcome.loads.size()}, "", line.r2, end ? 0.95 : 0.9);
    report.at_least("regions loaded", all, "", static_cast<double>(outcome.loads.size()), 100);
  }
  const Outcome &none = outcomes.front(), &whole = outcomes.back();
  report.at_least("records received twice", "no spare", "", static_cast<double>(none.twice), 1);
  report.at_most("records received twice", "whole model", "", static_cast<double>(whole.twice), 0);
  report.at_most("records received, whole model / no spare", "all cycles", "times",
                 static_cast<double>(whole.received) / static_cast<double>(none.received), 1);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "cache", "What a cache is worth: T_L, loader time and what comes twice, from no spare room to the whole model",
      "5 s, without a bound on how linear, for CI"};
  app.add_option("--model", settings.model, "model file of any kind, or .spm (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--seconds", settings.seconds, "of the path, out and back")->check(CLI::Range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "of the tip, m/s")->check(CLI::Range(0.001, 2.0));
  app.add_option("--seed", settings.seed, "of the path");
  app.add_option("--repeats", settings.repeats, "of each cache, for the least time of each load")
      ->check(CLI::Range(1u, 100u));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    settings.quick = app.quick;
    if (app.quick) settings.seconds = std::min(settings.seconds, 5.0);
    return tactus::bench::run(settings);
  });
}
