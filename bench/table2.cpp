// Repeats the measurements of the paper's Table 2: T_R, T_B and T_Q of local refinement, and T_Q on the original mesh
// and on the base mesh. A sphere and the stylus follow the same path in one run, each on its own refined mesh.
//
// The paper's bunny has 37,576 faces. A larger model is first simplified to that size. Without --model, the model is a
// generated organ of that size.
#include <algorithm>
#include <array>
#include <cstdio>

#include "bench/bench_main.hpp"
#include "bench/query_run.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/import.hpp"

namespace tactus::bench {
namespace {

using spm::offline::TriangleMesh;

/// Times of the paper, ms on a Pentium 4 of 2.8 GHz.
struct PaperTimes {
  double refine = 5.4, refit = 1.8, query = 2.87, original = 5.7, base = 2.75;
};

/// Returns the base mesh.
TriangleMesh base_mesh(const spm::Model& model) {
  TriangleMesh base;
  const auto vertices = model.positions.subspan(0, model.summary.base_vertices);
  base.positions.assign(vertices.begin(), vertices.end());
  base.faces = spm::base_triangles(model);
  return base;
}

/// Loads or generates the model, simplified to at most `settings.faces` faces.
LoadedModel load(const QuerySettings& settings) {
  using namespace spm::offline;
  std::fprintf(stderr, "building the model\n");
  BuildOptions options;
  options.size = 0.1;
  LoadedModel loaded;
  const bool generated = settings.model.empty();
  TriangleMesh mesh = generated ? generate(Shape::kOrgan, settings.faces) : import_mesh(settings.model);
  loaded.name = generated ? "organ, " + std::to_string(settings.faces) + " faces" : settings.model;
  if (mesh.faces.size() > settings.faces) {
    options.simplify.base_faces = settings.faces;
    mesh = base_mesh(build_model(std::move(mesh), options).model());
    options.simplify.base_faces = BuildOptions{}.simplify.base_faces;
    loaded.name += " simplified to " + std::to_string(mesh.faces.size()) + " faces";
  }
  const auto built = std::make_shared<const BuiltModel>(build_model(std::move(mesh), options));
  loaded.model = built->model();
  loaded.owner = built;
  loaded.finest = finest_faces(loaded.model);
  return loaded;
}

/// Index of a contender in QueryRun::fixed. Embree is at 0 and 3.
enum ContenderIndex : std::size_t { kOriginalTree = 1, kOriginalFcl = 2, kBaseTree = 4, kBaseFcl = 5 };

/// Runs the queries of one probe on the refined mesh and on both fixed meshes.
QueryRun run_kind(const QueryScene& scene, ProbeKind kind, FixedMesh& original, FixedMesh& base) {
  std::vector<Contender> fixed;
  for (const auto& [meshes, name] : {std::pair{&original, "original"}, {&base, "base"}}) {
    for (Contender& contender : meshes->contenders(kind, name, static_cast<int>(fixed.size())))
      fixed.push_back(std::move(contender));
    fixed.push_back(meshes->fcl_contender(kind, name));
  }
  return run_queries(scene, kind, std::move(fixed), false);
}

void add_rows(Report& report, const std::string& probe, const QueryRun& run) {
  const RefinedFigures& r = run.refined;
  const std::string all = "cycles", changed = "cycles that split or collapsed a record";
  report.add_percentiles(probe + ", T_R", all, "us", r.refine);
  report.add_percentiles(probe + ", T_R", changed, "us", r.changed_refine);
  report.add_percentiles(probe + ", T_B", all, "us", r.refit);
  report.add_percentiles(probe + ", T_B", changed, "us", r.changed_refit);
  report.add_percentiles(probe + ", T_Q, refined", all, "us", r.query);
  report.add_percentiles(probe + ", T_R + T_B + T_Q", all, "us", r.frame);
  for (const Contender& contender : run.fixed)
    report.add_percentiles(probe + ", T_Q, " + contender.name, all, "us", contender.times_us);
}

Report run(const QuerySettings& settings) {
  const QueryScene scene{load(settings), settings};
  const spm::ModelSummary& summary = scene.subject.model.summary;
  FixedMesh original{scene, finest_mesh(scene.subject)}, base{scene, base_mesh(scene.subject.model)};
  const QueryRun sphere = run_kind(scene, ProbeKind::kSphere, original, base);
  const QueryRun stylus = run_kind(scene, ProbeKind::kStylus, original, base);

  Report report{{scene.subject.name, summary.digest, summary.faces, scene.text()}};
  add_rows(report, "sphere", sphere);
  add_rows(report, "stylus", stylus);
  char text[160];
  std::snprintf(text, sizeof text, "%-36s %10s %12s %12s", "medians", "paper, ms", "sphere, us", "stylus, us");
  report.add_note(text);
  const auto add_line = [&](const char* name, double theirs, const Samples& of_sphere, const Samples& of_stylus) {
    std::snprintf(text, sizeof text, "%-36s %10.2f %12.2f %12.2f", name, theirs, of_sphere.percentile(0.5),
                  of_stylus.percentile(0.5));
    report.add_note(text);
  };
  const PaperTimes paper;
  const RefinedFigures &s = sphere.refined, &t = stylus.refined;
  add_line("T_R (cycles that changed the mesh)", paper.refine, s.changed_refine, t.changed_refine);
  add_line("T_B (cycles that changed the mesh)", paper.refit, s.changed_refit, t.changed_refit);
  add_line("T_Q, locally refined", paper.query, s.query, t.query);
  for (const auto& [name, theirs, index] : {std::tuple{"T_Q, original", paper.original, kOriginalTree},
                                            {"T_Q, base", paper.base, kBaseTree},
                                            {"T_Q, original, FCL", paper.original, kOriginalFcl},
                                            {"T_Q, base, FCL", paper.base, kBaseFcl}})
    add_line(name, theirs, sphere.fixed[index].times_us, stylus.fixed[index].times_us);
  report.add_value("paper: T_Q on the refined mesh divided by T_Q on the base mesh", {"table in the paper", 1}, "times",
                   paper.query / paper.base);
  for (const auto& [probe, of] : {std::pair{"sphere", &sphere}, {"stylus", &stylus}})
    report.add_value(std::string{probe} + ": median T_Q on the refined mesh divided by that on the base mesh",
                     {"cycles", of->refined.query.size()}, "times",
                     of->refined.query.percentile(0.5) / of->fixed[kBaseTree].times_us.percentile(0.5));

  add_comparisons(report, "sphere", sphere);
  add_comparisons(report, "stylus", stylus);
  for (const auto& [probe, of] : {std::pair{"sphere", &sphere}, {"stylus", &stylus}})
    report.add_at_most(
        std::string{probe} +
            ": median T_Q on the refined mesh divided by that on the original mesh (paper: 2.87 / 5.7 ms)",
        {"cycles", of->refined.query.size()}, "times",
        of->refined.query.percentile(0.5) / of->fixed[kOriginalTree].times_us.percentile(0.5),
        paper.query / paper.original);
  const double paper_sum = paper.refine + paper.refit + paper.query;  // ms
  report.add_at_most("stylus: p99 of T_R + T_B + T_Q divided by the paper's sum", {"cycles", t.frame.size()}, "times",
                     t.frame.percentile(0.99) / (1e3 * paper_sum), 0.05);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::QuerySettings settings;
  settings.faces = 37576;  // of the paper's bunny
  tactus::bench::App app{"table2", "Repeats the measurements of the paper's Table 2", "uses a path of 2 s"};
  tactus::bench::add_query_options(app, settings);
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick) settings.seconds = std::min(settings.seconds, 2.0);
    return tactus::bench::run(settings);
  });
}
