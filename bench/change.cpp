// One cell's step of the wanted set, refit included, beside FCL's refit and rebuild of the whole tree.
//
// A tip follows the surface with everything loaded and no budget. Whenever the set of labelled cells that it meets
// changes, the cells that enter and leave are taken one at a time: each is one step, retarget, refine or coarsen,
// refit. A second walk takes the tip a whole cell further at once, and all that changes with it in one step.
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

constexpr double kPeriod = 0.001;  // s
constexpr double kTouch = 1e-3;    // of a cell: how far below its edge counts as one cell further

struct Settings {
  std::string model;
  std::uint32_t faces = 1'000'000;
  double seconds = 60;
  double radius = 0.003;  // m
  double speed = 0.05;    // m/s
  double depth = 0.0002;  // m
  std::uint64_t seed = 1;
  bool quick = false;
};

struct Steps {
  Samples all, in, out;     // us: one cell
  Samples records, marked;  // of one cell's step
  Samples whole;            // us: the tip a cell further
  Samples whole_records;
  Samples of_bound, of_paper;  // marked nodes, as a share
  std::uint64_t beyond_bound = 0, not_done = 0;
  std::uint64_t refits = 0;
};

/// The paper's lemma 1 for a binary tree over n leaves of which k change.
double paper_bound(double changed, double faces) { return changed * (std::log2(faces) - std::log2(changed) + 2); }

class Walk {
 public:
  Walk(const spm::Model& model, double radius)
      : hrtc_{model, spm::PoolSettings::for_slots(slots_for(model.summary, 1))}, radius_{radius} {
    for (std::uint32_t region = 0; region < model.summary.regions; ++region)
      if (hrtc_.load(hrtc_.message(RegionId{region}, false)) != spm::AcceptResult::kAccepted)
        throw std::runtime_error("region " + std::to_string(region) + " does not fit a pool for the whole model");
  }

  void cell_by_cell(const std::vector<Vec3d>& path) {
    for (const Vec3d& tip : path) {
      meet(tip);
      if (met_ == wanted_) continue;
      std::vector<RegionId> entering, leaving;
      std::set_difference(met_.begin(), met_.end(), wanted_.begin(), wanted_.end(), std::back_inserter(entering));
      std::set_difference(wanted_.begin(), wanted_.end(), met_.begin(), met_.end(), std::back_inserter(leaving));
      const bool first = wanted_.empty();
      for (const RegionId region : entering) {
        wanted_.push_back(region);
        take(first ? nullptr : &steps_.in);
      }
      for (const RegionId region : leaving) {
        wanted_.erase(std::find(wanted_.begin(), wanted_.end(), region));
        take(&steps_.out);
      }
      wanted_ = met_;
    }
  }

  /// The tip jumps along the path by an edge of a cell at least.
  void cell_further(const std::vector<Vec3d>& path) {
    const double edge = hrtc_.model().summary.grid.cell_size * (1 - kTouch);
    Vec3d last = path.front();
    for (const Vec3d& tip : path) {
      if ((tip - last).norm() < edge) continue;
      last = tip;
      meet(tip);
      wanted_ = met_;
      const double us = step();
      steps_.whole.add(us);
      steps_.whole_records.add(static_cast<double>(changed_));
    }
  }

  [[nodiscard]] const Steps& steps() const noexcept { return steps_; }
  [[nodiscard]] const HrtcModel& hrtc() const noexcept { return hrtc_; }

 private:
  void meet(const Vec3d& tip) {
    met_.clear();
    hrtc_.forest().grid().for_each_meeting(tip, radius_, [&](RegionId region, double) { met_.push_back(region); });
    std::sort(met_.begin(), met_.end());
  }

  void take(Samples* kind) {
    const double us = step();
    if (kind == nullptr) return;
    kind->add(us);
    steps_.all.add(us);
    steps_.records.add(static_cast<double>(changed_));
    steps_.marked.add(refit_.marked);
  }

  double step() {
    spm::Forest& forest = hrtc_.forest();
    const spm::ForestCounters before = forest.counters();
    spm::Budget budget{~0u};
    Stopwatch watch;
    forest.target(wanted_.data(), static_cast<std::uint32_t>(wanted_.size()));
    const spm::Advance advance = forest.advance(budget);
    refit_ = forest.refit();
    const double us = watch.lap();
    changed_ = forest.counters().splits - before.splits + forest.counters().collapses - before.collapses;
    if (advance != spm::Advance::kDone) ++steps_.not_done;
    ++steps_.refits;
    if (refit_.marked > refit_.bound) ++steps_.beyond_bound;
    if (refit_.changed == 0) return us;
    steps_.of_bound.add(refit_.marked / static_cast<double>(refit_.bound));
    steps_.of_paper.add(refit_.marked / paper_bound(refit_.changed, hrtc_.model().summary.faces));
    return us;
  }

  HrtcModel hrtc_;
  double radius_;
  std::vector<RegionId> met_, wanted_;
  spm::RefitCount refit_;
  std::uint64_t changed_ = 0;
  Steps steps_;
};

Samples repeats(int count, spm::fcl::FixedMesh& mesh, void (spm::fcl::FixedMesh::*work)()) {
  Samples samples;
  for (int i = 0; i < count; ++i) {
    Stopwatch watch;
    (mesh.*work)();
    samples.add(watch.lap());
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
  Walk walk{subject.model, settings.radius / unit};
  walk.cell_by_cell(path);
  walk.cell_further(path);
  const Steps& steps = walk.steps();
  std::fprintf(stderr, "FCL\n");
  const Samples refit = repeats(settings.quick ? 5 : 21, finest, &spm::fcl::FixedMesh::refit);
  const Samples rebuild = repeats(settings.quick ? 1 : 5, finest, &spm::fcl::FixedMesh::rebuild);

  char text[256];
  std::snprintf(text, sizeof text, "radius %g mm, %g cm/s for %g s, %.3g m long, %u regions of %.3g mm, path seed %llu",
                settings.radius * 1e3, settings.speed * 1e2, settings.seconds, longest_side(summary), summary.regions,
                summary.grid.cell_size * unit * 1e3, static_cast<unsigned long long>(settings.seed));
  Report report{{subject.name, summary.digest, summary.faces, text}};
  const std::string cell = "one cell's steps";
  report.row("change and refit", cell, "us", steps.all);
  report.row("  cell enters", cell, "us", steps.in);
  report.row("  cell leaves", cell, "us", steps.out);
  report.row("records changed", cell, "", steps.records);
  report.row("nodes marked", cell, "", steps.marked);
  report.row("change and refit", "tip one cell further", "us", steps.whole);
  report.row("records changed", "tip one cell further", "", steps.whole_records);
  report.row("marked / exact bound", "refits", "", steps.of_bound);
  report.row("marked / k(log2 n - log2 k + 2)", "refits", "", steps.of_paper);
  report.row("FCL refit, finest mesh", "repeats", "us", refit);
  report.row("FCL rebuild, finest mesh", "repeats", "us", rebuild);

  report.at_least("steps", cell, "", static_cast<double>(steps.all.size()), 100);
  report.at_most("refits that marked more than the exact bound", {"refits", steps.of_bound.size()}, "",
                 static_cast<double>(steps.beyond_bound), 0);
  report.at_most("steps left undone", {"all", steps.all.size()}, "", static_cast<double>(steps.not_done), 0);
  const double median = steps.all.percentile(0.5);
  report.at_most("median of change and refit", {cell, steps.all.size()}, "us", median, 100);
  report.at_least("FCL refit / change and refit, medians", {cell, refit.size()}, "times",
                  refit.percentile(0.5) / median, 500);
  report.at_least("FCL rebuild / change and refit, medians", {cell, rebuild.size()}, "times",
                  rebuild.percentile(0.5) / median, 1000);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"change", "One cell's step of the wanted set, refit included, beside FCL's refit and rebuild",
                         "5 s, for CI"};
  app.add_option("--model", settings.model, "model file of any kind, or .spm (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 30000000u));
  app.add_option("--seconds", settings.seconds, "length of the path")->check(CLI::Range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "of the tip, m/s")->check(CLI::Range(0.001, 2.0));
  app.add_option("--seed", settings.seed, "of the path");
  return tactus::bench::bench_main(app, argc, argv, [&] {
    settings.quick = app.quick;
    if (app.quick) settings.seconds = std::min(settings.seconds, 5.0);
    return tactus::bench::run(settings);
  });
}
