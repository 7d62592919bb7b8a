// Measures T_Q and the frame T_R + T_B + T_Q of a sphere and of a stylus on the locally refined mesh. Compares them
// with T_Q of Embree and of the AB-tree on the fixed finest mesh, in the same run.
#include <algorithm>
#include <cstdio>

#include "bench/bench_main.hpp"
#include "bench/query_run.hpp"

namespace tactus::bench {
namespace {

constexpr double kHalfCycle = 500;  // us; the other half of a cycle is for forces, devices and the system

void add_rows(Report& report, const std::string& probe, const QueryRun& run) {
  const RefinedFigures& r = run.refined;
  const std::string all = "cycles", cold = "cold cycles";
  report.add_percentiles(probe + ", T_Q, refined mesh", all, "us", r.query);
  report.add_percentiles(probe + ", T_R + T_B + T_Q", all, "us", r.frame, {{0.999, kHalfCycle}});
  for (const Contender& contender : run.fixed)
    report.add_percentiles(probe + ", T_Q, " + contender.name, all, "us", contender.times_us);
  report.add_percentiles(probe + ", T_Q, refined mesh", cold, "us", r.cold_query);
  report.add_percentiles(probe + ", T_R + T_B + T_Q", cold, "us", r.cold_frame, {{0.99, kHalfCycle}});
  for (const Contender& contender : run.fixed)
    report.add_percentiles(probe + ", T_Q, " + contender.name, cold, "us", contender.cold_us);
}

/// Adds the bounds. A query of the refined mesh must take no longer than a query of the fastest tree of a fixed mesh.
void add_bounds(Report& report, const std::string& probe, const QueryRun& run) {
  const RefinedFigures& r = run.refined;
  const Samples &embree = run.fixed[0].times_us, &tree = run.fixed[1].times_us;
  const auto add_ratio = [&](const std::string& what, const Samples& a, const Samples& b) {
    report.add_at_most(probe + ": median " + what, {"cycles", a.size()}, "times", a.percentile(0.5) / b.percentile(0.5),
                       1);
  };
  add_comparisons(report, probe, run);
  report.add_value(probe + ": median T_R + T_B + T_Q divided by median T_Q of Embree", {"cycles", r.frame.size()},
                   "times", r.frame.percentile(0.5) / embree.percentile(0.5));
  report.add_value(probe + ": median T_R + T_B + T_Q divided by median T_Q of the AB-tree", {"cycles", r.frame.size()},
                   "times", r.frame.percentile(0.5) / tree.percentile(0.5));
  add_ratio("T_Q of the refined mesh divided by that of Embree on the finest mesh", r.query, embree);
  add_ratio("T_Q of the refined mesh divided by that of the AB-tree on the finest mesh", r.query, tree);
  add_ratio("T_Q of the AB-tree divided by that of Embree, both on the finest mesh", tree, embree);
}

Report run(const QuerySettings& settings, double edge) {
  std::fprintf(stderr, "building the model\n");
  LoadedModel subject = load_model(settings.model, settings.faces);
  if (edge > 0) scale_to_edge(subject, edge);
  const QueryScene scene{std::move(subject), settings};
  const spm::ModelSummary& summary = scene.subject.model.summary;
  FixedMesh finest{scene, finest_mesh(scene.subject)};
  const auto run_kind = [&](ProbeKind kind) {
    return run_queries(scene, kind, finest.contenders(kind, "finest mesh", 0), true);
  };
  const QueryRun sphere = run_kind(ProbeKind::kSphere), stylus = run_kind(ProbeKind::kStylus);

  Report report{{scene.subject.name, summary.digest, summary.faces, scene.text()}};
  add_rows(report, "sphere", sphere);
  add_rows(report, "stylus", stylus);
  report.add_note("Cold: the benchmark writes 64 MiB of other memory before the query, or before the frame.");
  report.add_note(
      "A frame must take at most half of a 1 ms cycle. A query of the refined mesh must take no longer than");
  report.add_note(
      "one of the fastest tree of a fixed mesh. If the frame takes longer than that query, refinement saves memory and "
      "start-up time, but no time in a cycle.");
  add_bounds(report, "sphere", sphere);
  add_bounds(report, "stylus", stylus);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::QuerySettings settings;
  double edge = 0;
  tactus::bench::App app{
      "query",
      "Times queries of a sphere and of a stylus on the refined mesh, and with Embree and the AB-tree on "
      "the finest mesh",
      "uses a path of 2 s"};
  tactus::bench::add_query_options(app, settings);
  app.add_option("--edge", edge, "scales the model to this mean edge length, m")
      ->check(tactus::wire::finite_range(1e-5, 1e-2));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = std::min(settings.seconds, 2.0);
    return tactus::bench::run(settings, edge);
  });
}
