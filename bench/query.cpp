// T_Q of a sphere and of a stylus on the locally refined mesh, and whole frames T_R + T_B + T_Q, beside Embree and the
// AB-tree on the static finest mesh, in one run.
#include <algorithm>
#include <cstdio>

#include "bench/bench_main.hpp"
#include "bench/query_run.hpp"

namespace tactus::bench {
namespace {

constexpr double kHalfCycle = 500;  // us of 1 ms; the other half is for force, devices and system

void add_rows(Report& report, const std::string& probe, const QueryRun& run) {
  const RefinedTimes& r = run.refined;
  const std::string all = "all cycles", cold = "every 10th, cold";
  report.row(probe + ", T_Q, refined mesh", all, "us", r.query);
  report.row(probe + ", T_R + T_B + T_Q", all, "us", r.frame, {{0.999, kHalfCycle}});
  for (const Contender& contender : run.fixed)
    report.row(probe + ", T_Q, " + contender.name, all, "us", contender.times);
  report.row(probe + ", T_Q, refined mesh", cold, "us", r.cold_query);
  report.row(probe + ", T_R + T_B + T_Q", cold, "us", r.cold_frame, {{0.99, kHalfCycle}});
  for (const Contender& contender : run.fixed)
    report.row(probe + ", T_Q, " + contender.name, cold, "us", contender.cold);
}

/// The refined mesh must not cost a query more than the best static trees, and its frame must fit the cycle.
void add_bounds(Report& report, const std::string& probe, const QueryRun& run) {
  const RefinedTimes& r = run.refined;
  const Samples &embree = run.fixed[0].times, &tree = run.fixed[1].times;
  const auto ratio = [&](const std::string& what, const Samples& a, const Samples& b) {
    report.at_most(probe + ": median of " + what, {"all cycles", a.size()}, "times",
                   a.percentile(0.5) / b.percentile(0.5), 1);
  };
  add_comparisons(report, probe, run);
  report.figure(probe + ", T_R + T_B + T_Q over T_Q, Embree", "medians", "times",
                r.frame.percentile(0.5) / embree.percentile(0.5));
  report.figure(probe + ", T_R + T_B + T_Q over T_Q, AB-tree", "medians", "times",
                r.frame.percentile(0.5) / tree.percentile(0.5));
  ratio("T_Q, refined over Embree on the finest mesh", r.query, embree);
  ratio("T_Q, refined over AB-tree of the finest mesh", r.query, tree);
  ratio("T_Q, AB-tree over Embree, both on the finest mesh", tree, embree);
}

Report run(const QuerySettings& settings, double edge) {
  std::fprintf(stderr, "making the model\n");
  LoadedModel subject = load_model(settings.model, settings.faces);
  if (edge > 0) scale_to_edge(subject, edge);
  const QueryScene scene{std::move(subject), settings};
  const spm::ModelSummary& summary = scene.subject.model.summary;
  FixedMeshes finest{scene, finest_mesh(scene.subject)};
  const auto run_kind = [&](ProbeKind kind) {
    return run_queries(scene, kind, finest.contenders(kind, "finest mesh", 0), true);
  };
  const QueryRun sphere = run_kind(ProbeKind::kSphere), stylus = run_kind(ProbeKind::kStylus);

  Report report{{scene.subject.name, summary.digest, summary.faces, scene.text()}};
  add_rows(report, "sphere", sphere);
  add_rows(report, "stylus", stylus);
  report.note("Cold: 64 MiB of other memory are walked before the query, or before the frame.");
  report.note("A frame must take half of a 1 ms cycle at most. A query of the refined mesh must not take longer than");
  report.note("one of the best static tree; where the frame does, refinement buys memory and start-up, not time.");
  add_bounds(report, "sphere", sphere);
  add_bounds(report, "stylus", stylus);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::QuerySettings settings;
  double edge = 0;
  tactus::bench::App app{"query",
                         "Sphere and stylus queries on the refined mesh, beside Embree and the AB-tree on the finest",
                         "2 s of path"};
  tactus::bench::add_query_options(app, settings);
  app.add_option("--edge", edge, "scale the model to this mean edge, m")->check(CLI::Range(1e-5, 1e-2));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = std::min(settings.seconds, 2.0);
    return tactus::bench::run(settings, edge);
  });
}
