// The paper's Table 2 beside today's: T_R, T_B and T_Q of local refinement, and T_Q on the original and on the base
// mesh, with a sphere and with the stylus, all along one path in one run.
//
// The paper's bunny has 37,576 faces; a larger model is first brought to that size by this project's own
// simplification. Without --model a generated organ of that size stands in.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <functional>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/embree_mesh.hpp"
#include "bench/figures.hpp"
#include "bench/models.hpp"
#include "bench/refined_run.hpp"
#include "bench/stopwatch.hpp"
#include "bench/stylus.hpp"
#include "spm/fcl/fixed_mesh.hpp"
#include "spm/finest_tree.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/import.hpp"

namespace tactus::bench {
namespace {

using spm::Vec3d;
using spm::offline::TriangleMesh;

constexpr std::uint32_t kContacts = 1u << 14;
constexpr std::uint32_t kPaperFaces = 37576;

/// Milliseconds on a Pentium 4 of 2.8 GHz.
struct Paper {
  double refine = 5.4, refit = 1.8, query = 2.87, original = 5.7, base = 2.75;
};

struct Settings {
  std::string model, json;
  std::uint32_t faces = kPaperFaces;
  double seconds = 20;
  double radius = 0.003;  // m
  double speed = 0.05;    // m/s
  double depth = 0.0002;  // m
  double pool_share = 0.25;
  std::uint32_t budget = 1000;
  std::uint64_t seed = 1;
  bool quick = false;
};

/// The base mesh alone.
TriangleMesh base_of(const spm::Model& model) {
  TriangleMesh base;
  const auto vertices = model.positions.subspan(0, model.summary.base_vertices);
  base.positions.assign(vertices.begin(), vertices.end());
  for (const spm::BaseFace& face : model.base_faces) base.faces.push_back(face.corners);
  return base;
}

LoadedModel load(const Settings& settings) {
  using namespace spm::offline;
  BuildOptions options;
  options.size = 0.1;
  LoadedModel loaded;
  const bool generated = settings.model.empty();
  TriangleMesh mesh = generated ? generate(Shape::kOrgan, settings.faces) : import_mesh(settings.model);
  loaded.name = generated ? "organ, " + std::to_string(settings.faces) + " faces" : settings.model;
  if (mesh.faces.size() > settings.faces) {
    options.simplify.base_faces = settings.faces;
    mesh = base_of(build_model(std::move(mesh), options).model());
    options.simplify.base_faces = BuildOptions{}.simplify.base_faces;
    loaded.name += " simplified to " + std::to_string(mesh.faces.size()) + " faces";
  }
  const auto built = std::make_shared<const BuiltModel>(build_model(std::move(mesh), options));
  loaded.model = built->model();
  loaded.owner = built;
  loaded.finest = finest_faces(loaded.model);
  return loaded;
}

/// One fixed mesh in the trees of everyone.
struct Fixed {
  explicit Fixed(const TriangleMesh& mesh, const TriangleMesh& stylus)
      : fcl{mesh.positions, mesh.faces},
        embree{mesh.positions, mesh.faces},
        embree_stylus{embree, stylus.positions, stylus.faces},
        ours{mesh.positions, mesh.faces} {}
  spm::fcl::FixedMesh fcl;
  EmbreeMesh embree;
  EmbreeMesh::Probe embree_stylus;
  spm::FinestTree ours;
  Samples fcl_sphere, fcl_stylus, embree_sphere_us, embree_stylus_us, ours_sphere, ours_stylus;
  std::vector<std::uint32_t> sphere_count, stylus_count;  // contacts of ours, by pose
  std::uint64_t other_counts = 0;                         // queries in which FCL or Embree count differently
};

void query_all(Fixed& fixed, const std::vector<SurfacePose>& path, const std::vector<Eigen::Isometry3d>& poses,
               double radius, const spm::MeshProbe& probe, const TriangleMesh& stylus) {
  spm::PlacedProbe placed{probe};
  std::vector<spm::Contact> contacts(kContacts), embree_contacts;
  std::vector<spm::MeshContact> pairs(kContacts), embree_pairs;
  std::vector<std::uint32_t> fcl_faces;
  std::vector<std::array<std::uint32_t, 2>> fcl_pairs;
  spm::fcl::FixedMesh fcl_stylus{stylus.positions, stylus.faces};
  std::vector<std::array<float, 3>> moved = stylus.positions;
  // One contender after the other over the whole path: each has its own data at hand.
  for (const SurfacePose& pose : path) {
    Stopwatch watch;
    fixed.sphere_count.push_back(fixed.ours.tree().touching(pose.centre, radius, contacts.data(), kContacts));
    fixed.ours_sphere.add(watch.lap());
  }
  for (const Eigen::Isometry3d& pose : poses) {
    Stopwatch watch;
    placed.place(pose);
    fixed.stylus_count.push_back(placed.touching(fixed.ours.tree(), pairs.data(), kContacts).contacts);
    fixed.ours_stylus.add(watch.lap());
  }
  for (std::size_t i = 0; i < path.size(); ++i) {
    Stopwatch watch;
    fixed.embree.touching(path[i].centre, radius, embree_contacts);
    fixed.embree_sphere_us.add(watch.lap());
    fixed.other_counts += embree_contacts.size() != fixed.sphere_count[i] ? 1 : 0;
  }
  for (std::size_t i = 0; i < path.size(); ++i) {
    Stopwatch watch;
    fixed.embree_stylus.touching(poses[i], embree_pairs);
    fixed.embree_stylus_us.add(watch.lap());
    fixed.other_counts += embree_pairs.size() != fixed.stylus_count[i] ? 1 : 0;
  }
  for (const SurfacePose& pose : path) {
    Stopwatch watch;
    fixed.fcl.touching(pose.centre, radius, fcl_faces);
    fixed.fcl_sphere.add(watch.lap());
  }
  for (const Eigen::Isometry3d& pose : poses) {
    Stopwatch watch;
    for (std::size_t v = 0; v < moved.size(); ++v) {
      const std::array<float, 3>& p = stylus.positions[v];
      const Vec3d at = pose * Vec3d{p[0], p[1], p[2]};
      for (std::size_t axis = 0; axis < 3; ++axis) moved[v][axis] = static_cast<float>(at[static_cast<int>(axis)]);
    }
    fcl_stylus.move(moved);
    fcl_stylus.refit();
    fixed.fcl.intersecting(fcl_stylus, fcl_pairs);
    fixed.fcl_stylus.add(watch.lap());
  }
}

struct Refined {
  Samples refine, refit, sphere, stylus, sum_sphere, sum_stylus;
  Samples changed_refine, changed_refit;
  std::uint64_t cycles = 0, exact = 0, other_counts = 0;
};

Refined run_refined(const LoadedModel& subject, const Settings& settings, const std::vector<SurfacePose>& path,
                    const std::vector<Eigen::Isometry3d>& poses, double radius, const spm::MeshProbe& probe,
                    const std::vector<std::uint32_t>& expected) {
  RefinedRun run{subject.model,
                 spm::ProbeShape{radius},
                 {settings.speed / subject.model.summary.metres_per_unit, settings.pool_share, settings.budget}};
  const spm::AbTree& tree = run.forest().tree();
  spm::PlacedProbe placed{probe};
  std::vector<spm::Contact> contacts(kContacts);
  std::vector<spm::MeshContact> pairs(kContacts);
  Refined r;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const RefinedStep step = run.step(path[i].centre, i > 0);
    Stopwatch watch;
    const std::uint32_t count = tree.touching(path[i].centre, radius, contacts.data(), kContacts);
    const double sphere = watch.lap();
    placed.place(poses[i]);
    static_cast<void>(placed.touching(tree, pairs.data(), kContacts));
    const double stylus = watch.lap();
    r.refine.add(step.refine);
    r.refit.add(step.refit);
    if (step.changes > 0) {
      r.changed_refine.add(step.refine);
      r.changed_refit.add(step.refit);
    }
    r.sphere.add(sphere);
    r.stylus.add(stylus);
    r.sum_sphere.add(step.refine + step.refit + sphere);
    r.sum_stylus.add(step.refine + step.refit + stylus);
    if (!run.settled()) continue;
    ++r.cycles;
    if (!run.forest().exact(path[i].centre, radius)) continue;
    ++r.exact;
    std::uint32_t finest = 0;
    for (std::uint32_t c = 0; c < std::min(count, kContacts); ++c) finest += contacts[c].last() ? 1 : 0;
    r.other_counts += finest != expected[i] ? 1 : 0;
  }
  return r;
}

int run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  const LoadedModel subject = load(settings);
  const spm::ModelSummary& summary = subject.model.summary;
  const double unit = summary.metres_per_unit, radius = settings.radius / unit;
  TriangleMesh finest;
  finest.positions.assign(subject.model.positions.begin(), subject.model.positions.end());
  finest.faces = subject.finest;
  const TriangleMesh stylus = stylus_in(unit);
  const spm::MeshProbe probe{stylus.positions, stylus.faces};
  Fixed original{finest, stylus}, base{base_of(subject.model), stylus};
  const PathSettings path_settings{radius, settings.depth / unit, settings.speed * kPeriod / unit,
                                   static_cast<std::uint32_t>(settings.seconds / kPeriod), settings.seed};
  const std::vector<SurfacePose> path = surface_poses(finest.positions, finest.faces, path_settings,
                                                      [&](const Vec3d& p) { return original.fcl.distance(p); });
  const std::vector<Eigen::Isometry3d> poses = stylus_poses(path);
  std::fprintf(stderr, "original and base, %zu cycles\n", path.size());
  query_all(original, path, poses, radius, probe, stylus);
  query_all(base, path, poses, radius, probe, stylus);
  std::fprintf(stderr, "refined\n");
  const Refined refined = run_refined(subject, settings, path, poses, radius, probe, original.sphere_count);

  char text[256];
  std::snprintf(
      text, sizeof text,
      "%u base faces, radius %g mm, stylus of %zu triangles, %g cm/s, %g mm deep, %g s, pool %g of the model, "
      "budget %u, path seed %llu",
      summary.base_faces, settings.radius * 1e3, stylus.faces.size(), settings.speed * 1e2, settings.depth * 1e3,
      settings.seconds, settings.pool_share, settings.budget, static_cast<unsigned long long>(settings.seed));
  Report report{{"table2", subject.name, summary.digest, summary.faces, text}};
  const Paper paper;
  const std::string all = "all cycles", changed = "cycles with changes";
  report.row("T_R", all, "us", refined.refine);
  report.row("T_R", changed, "us", refined.changed_refine);
  report.row("T_B", all, "us", refined.refit);
  report.row("T_B", changed, "us", refined.changed_refit);
  report.row("T_Q refined, sphere", all, "us", refined.sphere);
  report.row("T_Q refined, stylus", all, "us", refined.stylus);
  report.row("T_R + T_B + T_Q, sphere", all, "us", refined.sum_sphere);
  report.row("T_R + T_B + T_Q, stylus", all, "us", refined.sum_stylus);
  const auto fixed_rows = [&](const char* mesh, const Fixed& fixed) {
    const std::string q = std::string{"T_Q "} + mesh + ", ";
    report.row(q + "sphere, AB-tree", all, "us", fixed.ours_sphere);
    report.row(q + "sphere, Embree", all, "us", fixed.embree_sphere_us);
    report.row(q + "sphere, FCL", all, "us", fixed.fcl_sphere);
    report.row(q + "stylus, AB-tree", all, "us", fixed.ours_stylus);
    report.row(q + "stylus, Embree", all, "us", fixed.embree_stylus_us);
    report.row(q + "stylus, FCL", all, "us", fixed.fcl_stylus);
  };
  fixed_rows("original", original);
  fixed_rows("base", base);
  std::snprintf(text, sizeof text, "%-36s %10s %12s %12s", "medians", "paper, ms", "sphere, us", "stylus, us");
  report.note(text);
  const auto line = [&](const char* name, double theirs, const Samples& sphere, const Samples& tool) {
    std::snprintf(text, sizeof text, "%-36s %10.2f %12.2f %12.2f", name, theirs, sphere.percentile(50),
                  tool.percentile(50));
    report.note(text);
  };
  line("T_R (cycles with changes)", paper.refine, refined.changed_refine, refined.changed_refine);
  line("T_B (cycles with changes)", paper.refit, refined.changed_refit, refined.changed_refit);
  line("T_Q, locally refined", paper.query, refined.sphere, refined.stylus);
  line("T_Q, original", paper.original, original.ours_sphere, original.ours_stylus);
  line("T_Q, base", paper.base, base.ours_sphere, base.ours_stylus);
  line("T_Q, original, FCL", paper.original, original.fcl_sphere, original.fcl_stylus);
  line("T_Q, base, FCL", paper.base, base.fcl_sphere, base.fcl_stylus);
  const double exact = 100.0 * static_cast<double>(refined.exact) / static_cast<double>(refined.cycles);
  report.figure("exact", "after 0.2 s", "%", exact);
  report.figure("paper: T_Q refined / base", "", "times", paper.query / paper.base);
  report.figure("stylus: T_Q refined / base", "medians", "times",
                refined.stylus.percentile(50) / base.ours_stylus.percentile(50));
  report.figure("sphere: T_Q refined / base", "medians", "times",
                refined.sphere.percentile(50) / base.ours_sphere.percentile(50));

  report.at_most("sphere: cycles with another number of contacts than the original mesh", "exact cycles", "",
                 static_cast<double>(refined.other_counts), 0);
  report.at_most("queries in which Embree counts differently, original and base", all, "",
                 static_cast<double>(original.other_counts + base.other_counts), 0);
  report.at_least("exact", "after 0.2 s", "%", exact, 99);
  const double whole = paper.refine + paper.refit + paper.query;  // ms
  report.at_most("stylus: p99 of T_R + T_B + T_Q / the paper's sum", all, "times",
                 refined.sum_stylus.percentile(99) / (1e3 * whole), 0.05);
  report.at_most("stylus: median T_Q refined / FCL's on the original", all, "times",
                 refined.stylus.percentile(50) / original.fcl_stylus.percentile(50), 0.5);
  return report.finish(settings.json);
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  CLI::App app{"The paper's Table 2 beside today's times"};
  app.add_option("--model", settings.model, "model file (default: a generated organ)")->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces that the model is brought to")->check(CLI::Range(1000u, 20000000u));
  app.add_option("--seconds", settings.seconds, "length of the path")->check(CLI::Range(1.0, 3600.0));
  app.add_option("--speed", settings.speed, "of the tip, m/s")->check(CLI::Range(0.001, 2.0));
  app.add_option("--pool-share", settings.pool_share, "pool, as a share of the model's records")
      ->check(CLI::Range(0.01, 1.0));
  app.add_option("--budget", settings.budget, "of a cycle, units of spm::Budget")->check(CLI::Range(100u, 1000000u));
  app.add_option("--seed", settings.seed, "of the path");
  app.add_option("--json", settings.json, "the figures as JSON");
  app.add_flag("--quick", settings.quick, "2 s, for CI");
  return tactus::bench::bench_main(app, "tactus-bench-table2", argc, argv, [&] {
    if (settings.quick) settings.seconds = std::min(settings.seconds, 2.0);
    return tactus::bench::run(settings);
  });
}
