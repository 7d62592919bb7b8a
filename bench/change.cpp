// Measures the time of one change of the wanted set, refit included, compared with FCL's refit and rebuild of the whole
// tree.
//
// A tip follows a surface. All regions are loaded, and refinement has no budget. When the set of labelled cells that
// the tip intersects changes, the cells enter and leave the wanted set one at a time. Each such change is one step:
// set the targets, refine or coarsen, refit. On a second walk, the tip jumps by the size of a cell, and one step makes
// all changes of a jump.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/hrtc_model.hpp"
#include "bench/models.hpp"
#include "bench/stopwatch.hpp"
#include "bench/surface_path.hpp"
#include "spm/fcl/fixed_mesh.hpp"

namespace tactus::bench {
namespace {

using spm::RegionId;
using spm::Vec3d;

constexpr double kPeriod = 0.001;    // s
constexpr double kTolerance = 1e-3;  // of a cell's edge: a jump may be shorter by this

struct Settings {
  std::string model;
  std::uint32_t faces = 1'000'000;
  double seconds = 60;
  double radius = 0.003;  // m, of the tip
  double speed = 0.05;    // m/s, of the tip
  double depth = 0.0002;  // m, overlap of tip and surface
  std::uint64_t seed = 1;
  bool quick = false;
};

struct Steps {
  Samples cell_us, entering_us, leaving_us;      // steps of one cell: all, entering, leaving
  Samples cell_records, cell_marked;             // changed records and marked nodes of a step of one cell
  Samples jump_us, jump_records;                 // steps of a jump
  Samples marked_per_bound, marked_per_lemma_1;  // marked nodes divided by the bound
  std::uint64_t over_bound = 0, unfinished = 0;  // number of refits; number of steps
  std::uint64_t count = 0;                       // all steps, the first ones included
};

/// Max number of marked nodes by lemma 1 of the paper, for a binary tree over `faces` leaves of which `changed` change.
double lemma_1_bound(double changed, double faces) { return changed * (std::log2(faces) - std::log2(changed) + 2); }

class Walker {
 public:
  Walker(const spm::Model& model, double radius)
      : hrtc_{model, spm::PoolSettings::for_slots(slots_for(model.summary, 1))}, radius_{radius} {
    for (std::uint32_t region = 0; region < model.summary.regions; ++region)
      if (hrtc_.load(hrtc_.message(RegionId{region}, false)) != spm::AcceptResult::kAccepted)
        throw std::runtime_error("region " + std::to_string(region) + " does not fit a pool for the whole model");
  }

  void walk_cell_by_cell(const std::vector<Vec3d>& path) {
    for (const Vec3d& tip : path) {
      find_intersected(tip);
      if (intersected_ == wanted_) continue;
      std::vector<RegionId> entering, leaving;
      std::set_difference(intersected_.begin(), intersected_.end(), wanted_.begin(), wanted_.end(),
                          std::back_inserter(entering));
      std::set_difference(wanted_.begin(), wanted_.end(), intersected_.begin(), intersected_.end(),
                          std::back_inserter(leaving));
      const bool is_first = wanted_.empty();
      for (const RegionId region : entering) {
        wanted_.push_back(region);
        add_step(is_first ? nullptr : &steps_.entering_us);
      }
      for (const RegionId region : leaving) {
        wanted_.erase(std::find(wanted_.begin(), wanted_.end(), region));
        add_step(&steps_.leaving_us);
      }
      wanted_ = intersected_;  // sorted
    }
  }

  /// Moves the tip along the path in jumps of at least a cell's edge.
  void walk_by_jumps(const std::vector<Vec3d>& path) {
    const double edge = hrtc_.model().summary.grid.cell_size * (1 - kTolerance);
    Vec3d jump_start = path.front();
    for (const Vec3d& tip : path) {
      if ((tip - jump_start).norm() < edge) continue;
      jump_start = tip;
      find_intersected(tip);
      wanted_ = intersected_;
      const double us = step();
      steps_.jump_us.add(us);
      steps_.jump_records.add(static_cast<double>(changed_records_));
    }
  }

  [[nodiscard]] const Steps& steps() const noexcept { return steps_; }
  [[nodiscard]] const HrtcModel& hrtc() const noexcept { return hrtc_; }

 private:
  void find_intersected(const Vec3d& tip) {
    intersected_.clear();
    hrtc_.forest().grid().for_each_intersecting(tip, radius_,
                                                [&](RegionId region, double) { intersected_.push_back(region); });
    std::sort(intersected_.begin(), intersected_.end());
  }

  /// Makes one step and adds its time to `samples`, unless that is null.
  void add_step(Samples* samples) {
    const double us = step();
    if (samples == nullptr) return;
    samples->add(us);
    steps_.cell_us.add(us);
    steps_.cell_records.add(static_cast<double>(changed_records_));
    steps_.cell_marked.add(refit_count_.marked);
  }

  /// Makes one step to the wanted set. Returns its time, us.
  double step() {
    spm::Forest& forest = hrtc_.forest();
    const spm::ForestCounters before = forest.counters();
    spm::Budget budget{~0u};
    Stopwatch stopwatch;
    forest.set_targets(wanted_.data(), static_cast<std::uint32_t>(wanted_.size()));
    const spm::Advance advance = forest.advance(budget);
    refit_count_ = forest.refit();
    const double us = stopwatch.lap();
    changed_records_ = forest.counters().splits - before.splits + forest.counters().collapses - before.collapses;
    if (advance != spm::Advance::kDone) ++steps_.unfinished;
    ++steps_.count;
    if (refit_count_.marked > refit_count_.bound) ++steps_.over_bound;
    if (refit_count_.changed == 0) return us;
    steps_.marked_per_bound.add(refit_count_.marked / static_cast<double>(refit_count_.bound));
    steps_.marked_per_lemma_1.add(refit_count_.marked /
                                  lemma_1_bound(refit_count_.changed, hrtc_.model().summary.faces));
    return us;
  }

  HrtcModel hrtc_;
  double radius_;
  std::vector<RegionId> intersected_, wanted_;
  spm::RefitCount refit_count_;
  std::uint64_t changed_records_ = 0;
  Steps steps_;
};

Samples time_repeats(int count, spm::fcl::FixedMesh& mesh, void (spm::fcl::FixedMesh::*work)()) {
  Samples samples;
  for (int i = 0; i < count; ++i) {
    Stopwatch stopwatch;
    (mesh.*work)();
    samples.add(stopwatch.lap());
  }
  return samples;
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  LoadedModel subject = load_model(settings.model, settings.faces);
  if (settings.model.empty()) scale_to_edge(subject, kHandEdge);
  const spm::ModelSummary& summary = subject.model.summary;
  const double unit = summary.metres_per_unit;
  std::fprintf(stderr, "making the path\n");
  spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
  const PathSettings path_settings{settings.radius / unit, settings.depth / unit, settings.speed * kPeriod / unit,
                                   static_cast<std::uint32_t>(settings.seconds / kPeriod), settings.seed};
  const std::vector<Vec3d> path = surface_path(subject.model.positions, subject.finest, path_settings,
                                               [&](const Vec3d& p) { return finest.distance(p); });
  std::fprintf(stderr, "loading all regions, %zu poses\n", path.size());
  Walker walker{subject.model, settings.radius / unit};
  walker.walk_cell_by_cell(path);
  walker.walk_by_jumps(path);
  const Steps& steps = walker.steps();
  std::fprintf(stderr, "FCL\n");
  const Samples refit = time_repeats(settings.quick ? 5 : 21, finest, &spm::fcl::FixedMesh::refit);
  const Samples rebuild = time_repeats(settings.quick ? 1 : 5, finest, &spm::fcl::FixedMesh::rebuild);

  char text[256];
  std::snprintf(text, sizeof text, "radius %g mm, %g cm/s for %g s, %.3g m long, %u regions of %.3g mm, path seed %llu",
                settings.radius * 1e3, settings.speed * 1e2, settings.seconds, model_length(summary), summary.regions,
                summary.grid.cell_size * unit * 1e3, static_cast<unsigned long long>(settings.seed));
  Report report{{subject.name, summary.digest, summary.faces, text}};
  const std::string cell = "steps of one cell", jump = "jumps by one cell";
  report.add_percentiles("change and refit", cell, "us", steps.cell_us);
  report.add_percentiles("change and refit", "entering cells", "us", steps.entering_us);
  report.add_percentiles("change and refit", "leaving cells", "us", steps.leaving_us);
  report.add_percentiles("records changed", cell, "", steps.cell_records);
  report.add_percentiles("nodes marked", cell, "", steps.cell_marked);
  report.add_percentiles("change and refit", jump, "us", steps.jump_us);
  report.add_percentiles("records changed", jump, "", steps.jump_records);
  report.add_percentiles("marked nodes / exact bound", "refits", "", steps.marked_per_bound);
  report.add_percentiles("marked nodes / k(log2 n - log2 k + 2)", "refits", "", steps.marked_per_lemma_1);
  report.add_percentiles("FCL refit, finest mesh", "repeats", "us", refit);
  report.add_percentiles("FCL rebuild, finest mesh", "repeats", "us", rebuild);

  report.add_at_least("number of steps", {"all steps", steps.count}, "", static_cast<double>(steps.cell_us.size()),
                      100);
  report.add_at_most("refits that marked more than the exact bound", {"refits", steps.marked_per_bound.size()}, "",
                     static_cast<double>(steps.over_bound), 0);
  report.add_at_most("unfinished steps", {"all steps", steps.count}, "", static_cast<double>(steps.unfinished), 0);
  const double median = steps.cell_us.percentile(0.5);
  report.add_at_most("median of change and refit", {cell, steps.cell_us.size()}, "us", median, 100);
  report.add_at_least("median FCL refit / median change and refit", {"repeats", refit.size()}, "times",
                      refit.percentile(0.5) / median, 500);
  report.add_at_least("median FCL rebuild / median change and refit", {"repeats", rebuild.size()}, "times",
                      rebuild.percentile(0.5) / median, 1000);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{
      "change", "Time to change one cell of the wanted set, refit included, compared with FCL's refit and rebuild",
      "5 s, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--seconds", settings.seconds, "duration of the path, s")
      ->check(tactus::wire::finite_range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "speed of the tip, m/s")->check(tactus::wire::finite_range(0.001, 2.0));
  app.add_option("--seed", settings.seed, "seed of the path");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    settings.quick = app.quick;
    if (app.quick) settings.seconds = std::min(settings.seconds, 5.0);
    return tactus::bench::run(settings);
  });
}
