// Compares bounding volumes for the AB-tree: spheres, boxes, 18-DOPs and oriented boxes. Each is used in the same
// implicit tree with eight children a node, over the finest faces, along the same path, with the same tests of
// triangles.
#include "bench/volumes.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "bench/bench_main.hpp"
#include "bench/figures.hpp"
#include "bench/models.hpp"
#include "bench/stopwatch.hpp"
#include "bench/stylus.hpp"
#include "bench/surface_path.hpp"
#include "spm/finest_tree.hpp"
#include "spm/offline/face_order.hpp"
#include "spm/triangle.hpp"
#include "spm/triangle_pair.hpp"

namespace tactus::bench {
namespace {

using Triangles = std::vector<std::array<Vec3d, 3>>;

constexpr std::uint32_t kWidth = 8;
constexpr double kRadius = 0.003, kDepth = 0.0002;  // m

struct Settings {
  std::string model;
  std::uint32_t faces = 70000;
  std::uint32_t poses = 2000;
  double step = 0.001;  // m
  bool quick = false;
};

Triangles triangles_of(std::span<const std::array<float, 3>> positions,
                       std::span<const std::array<std::uint32_t, 3>> faces) {
  Triangles triangles;
  for (const auto& face : faces) {
    std::array<Vec3d, 3> corners;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto& p = positions[face[i]];
      corners[i] = {p[0], p[1], p[2]};
    }
    triangles.push_back(corners);
  }
  return triangles;
}

/// A tree in which node `id` of level l, counted from 1, contains the faces from id * 8^l on. levels_[0] is level 1.
template <class Volume>
class Tree {
 public:
  explicit Tree(const Triangles& triangles) : triangles_{triangles} {
    for (std::size_t count = triangles.size(); count > 1 || levels_.empty();) {
      count = (count + kWidth - 1) / kWidth;
      levels_.emplace_back(count);
      for (std::uint32_t id = 0; id < count; ++id) compute(levels_.size() - 1, id, nullptr);
    }
  }
  [[nodiscard]] std::size_t height() const { return levels_.size(); }
  [[nodiscard]] const std::vector<Volume>& nodes(std::size_t level) const { return levels_[level]; }
  /// Returns the number after the last child of a node at levels_[level]. Children are nodes, or faces if `level` is 0.
  [[nodiscard]] std::uint32_t end_of_children(std::size_t level, std::uint32_t id) const {
    const std::size_t count = level == 0 ? triangles_.size() : levels_[level - 1].size();
    return static_cast<std::uint32_t>(std::min<std::size_t>(count, kWidth * (std::size_t{id} + 1)));
  }

  /// Recomputes the volumes of all nodes above `faces`, which must be sorted. Returns the number of volumes.
  std::uint32_t refit(std::vector<std::uint32_t> faces) {
    std::uint32_t refitted = 0;
    for (std::size_t level = 0; level < levels_.size(); ++level) {
      for (std::uint32_t& id : faces) id /= kWidth;
      faces.erase(std::unique(faces.begin(), faces.end()), faces.end());
      for (const std::uint32_t id : faces) {
        const Volume before = levels_[level][id];
        compute(level, id, &before);
      }
      refitted += static_cast<std::uint32_t>(faces.size());
    }
    return refitted;
  }

  /// Adds the faces whose leaf volumes overlap the sphere to `faces`. Returns the number of volumes tested.
  std::uint32_t find(const Vec3d& centre, double radius, std::vector<std::uint32_t>& faces) const {
    std::uint32_t tested = 0;
    visit(height() - 1, 0, centre, radius, tested, faces);
    return tested;
  }

 private:
  void compute(std::size_t level, std::uint32_t id, const Volume* previous) {
    const std::uint32_t first = kWidth * id, end = end_of_children(level, id);
    if (level == 0) {
      const Points points{triangles_[first].data(), 3 * std::size_t{end - first}};
      levels_[level][id] = Volume::of(points);
    } else {
      levels_[level][id] =
          Volume::over(std::span<const Volume>{levels_[level - 1].data() + first, std::size_t{end - first}}, previous);
    }
  }
  void visit(std::size_t level, std::uint32_t id, const Vec3d& centre, double radius, std::uint32_t& tested,
             std::vector<std::uint32_t>& faces) const {
    ++tested;
    if (!levels_[level][id].overlaps_sphere(centre, radius)) return;
    for (std::uint32_t child = kWidth * id; child < end_of_children(level, id); ++child) {
      if (level == 0)
        faces.push_back(child);
      else
        visit(level - 1, child, centre, radius, tested, faces);
    }
  }

  const Triangles& triangles_;
  std::vector<std::vector<Volume>> levels_;
};

/// Finds overlapping leaves of the model's tree and the probe's tree. Moves the probe's volumes into the model's frame.
template <class Volume>
class ProbePairs {
 public:
  ProbePairs(const Tree<Volume>& model, const Tree<Volume>& probe)
      : model_{model}, probe_{probe}, moved_(probe.height()) {}
  /// Adds the pairs of leaves whose volumes overlap to `leaves`. Returns the number of pairs of volumes tested.
  std::uint32_t find(const Eigen::Isometry3d& pose, std::vector<std::array<std::uint32_t, 2>>& leaves) {
    for (std::size_t level = 0; level < moved_.size(); ++level) {
      moved_[level].clear();
      for (const Volume& volume : probe_.nodes(level)) moved_[level].push_back(volume.moved(pose));
    }
    tested_ = 0;
    visit(model_.height() - 1, 0, probe_.height() - 1, 0, leaves);
    return tested_;
  }

 private:
  void visit(std::size_t a, std::uint32_t i, std::size_t b, std::uint32_t j,
             std::vector<std::array<std::uint32_t, 2>>& leaves) {
    ++tested_;
    if (!model_.nodes(a)[i].overlaps(moved_[b][j])) return;
    if (a == 0 && b == 0) {
      leaves.push_back({i, j});
    } else if (a >= b) {
      for (std::uint32_t k = kWidth * i; k < model_.end_of_children(a, i); ++k) visit(a - 1, k, b, j, leaves);
    } else {
      for (std::uint32_t k = kWidth * j; k < probe_.end_of_children(b, j); ++k) visit(a, i, b - 1, k, leaves);
    }
  }

  const Tree<Volume>& model_;
  const Tree<Volume>& probe_;
  std::vector<std::vector<Volume>> moved_;
  std::uint32_t tested_ = 0;
};

/// Model, stylus, path and expected contacts.
struct Subjects {
  double radius;  // of the sphere, file units
  Triangles model, stylus;
  std::vector<SurfacePose> path;
  std::vector<Eigen::Isometry3d> poses;
  std::vector<std::vector<std::uint32_t>> touched;  // by pose: faces that the sphere touches, by the AB-tree
  std::vector<std::uint32_t> pairs;                 // by pose: number of intersecting pairs of triangles

  /// Returns the number of intersecting pairs of triangles in two leaves.
  [[nodiscard]] std::uint32_t intersections_in(std::uint32_t model_leaf, std::uint32_t stylus_leaf,
                                               const Eigen::Isometry3d& pose) const {
    std::uint32_t count = 0;
    for (std::size_t b = kWidth * stylus_leaf; b < std::min<std::size_t>(stylus.size(), kWidth * (stylus_leaf + 1));
         ++b) {
      const std::array<Vec3d, 3> moved{pose * stylus[b][0], pose * stylus[b][1], pose * stylus[b][2]};
      for (std::size_t a = kWidth * model_leaf; a < std::min<std::size_t>(model.size(), kWidth * (model_leaf + 1));
           ++a) {
        spm::PairContact contact;
        count += spm::intersect(model[a], moved, contact) ? 1 : 0;
      }
    }
    return count;
  }
};

template <class Volume>
void measure(Subjects& subjects, Report& report) {
  const std::string name = Volume::kName;
  std::fprintf(stderr, "%s\n", name.c_str());
  Tree<Volume> tree{subjects.model};
  const Tree<Volume> stylus{subjects.stylus};
  ProbePairs<Volume> probe{tree, stylus};
  Samples volumes, triangles, sphere_us, pair_volumes, pair_leaves, stylus_us, nodes, node_ns;
  std::uint64_t different = 0;
  std::vector<std::uint32_t> faces, touched;
  std::vector<std::array<std::uint32_t, 2>> leaves;
  constexpr int kRounds = 3;  // the min of their times counts, since other work on the machine only adds time
  for (std::size_t pose = 0; pose < subjects.path.size(); ++pose) {
    double min_sphere_us = 1e300, min_stylus_us = 1e300, min_refit_us = 1e300;
    std::uint32_t tested = 0, tested_pairs = 0, refitted = 0, intersections = 0;
    for (int round = 0; round < kRounds; ++round) {
      faces.clear();
      touched.clear();
      leaves.clear();
      Stopwatch watch;
      const Vec3d& centre = subjects.path[pose].centre;
      tested = tree.find(centre, subjects.radius, faces);
      for (const std::uint32_t face : faces) {
        const auto& t = subjects.model[face];
        if (spm::closest_point(centre, t[0], t[1], t[2]).squared_distance <= subjects.radius * subjects.radius)
          touched.push_back(face);
      }
      min_sphere_us = std::min(min_sphere_us, watch.lap());
      tested_pairs = probe.find(subjects.poses[pose], leaves);
      min_stylus_us = std::min(min_stylus_us, watch.lap());
      refitted = tree.refit(touched);
      min_refit_us = std::min(min_refit_us, watch.lap());
    }
    // The tests of pairs of triangles are the same for all volumes. Therefore they are not timed, and done for a sample
    // of poses.
    if (pose % 20 == 0)
      for (const auto& [i, j] : leaves) intersections += subjects.intersections_in(i, j, subjects.poses[pose]);
    if (subjects.pairs.size() == pose) subjects.pairs.push_back(intersections);
    different += touched != subjects.touched[pose] || intersections != subjects.pairs[pose] ? 1 : 0;
    volumes.add(tested);
    triangles.add(static_cast<double>(faces.size()));
    sphere_us.add(min_sphere_us);
    pair_volumes.add(tested_pairs);
    pair_leaves.add(static_cast<double>(leaves.size()));
    stylus_us.add(min_stylus_us);
    if (refitted > 0) {
      nodes.add(refitted);
      node_ns.add(min_refit_us * 1000 / refitted);
    }
  }
  report.add_value("floats of a volume", {name, 1}, "", sizeof(Volume) / sizeof(float));
  report.add_percentiles("sphere: volumes tested in a query", name, "", volumes);
  report.add_percentiles("sphere: triangles tested in a query", name, "", triangles);
  report.add_percentiles("sphere: time of a query with tests of triangles", name, "us", sphere_us);
  report.add_percentiles("stylus: pairs of volumes tested in a query", name, "", pair_volumes);
  report.add_percentiles("stylus: overlapping pairs of leaves in a query", name, "", pair_leaves);
  report.add_percentiles("stylus: time of a query without tests of triangles", name, "us", stylus_us);
  report.add_percentiles("refit above the touched faces: nodes", name, "", nodes);
  report.add_percentiles("refit above the touched faces: time of a node", name, "ns", node_ns);
  report.add_at_most("poses with contacts that differ from those of AB-tree or box",
                     {"poses, " + name, subjects.path.size()}, "", static_cast<double>(different), 0);
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "building the model\n");
  const LoadedModel subject = load_model(settings.model, settings.faces);
  const double unit = subject.model.summary.metres_per_unit;
  const spm::FinestTree finest{subject.model.positions, subject.finest};
  spm::offline::TriangleMesh stylus = stylus_in(unit);
  std::vector<std::array<std::uint32_t, 3>> ordered_faces;
  for (const std::uint32_t face : face_order(stylus)) ordered_faces.push_back(stylus.faces[face]);
  Subjects subjects{kRadius / unit,
                    triangles_of(subject.model.positions, subject.finest),
                    triangles_of(stylus.positions, ordered_faces),
                    {},
                    {},
                    {},
                    {}};
  const PathSettings path{subjects.radius, kDepth / unit, settings.step / unit, settings.poses, 1};
  subjects.path = surface_poses(subject.model.positions, subject.finest, path, [&](const Vec3d& p) {
    spm::NearestFace found;
    return finest.tree().nearest(p, 1e12, found) ? std::sqrt(found.squared_distance) : 1e300;
  });
  subjects.poses = stylus_poses(subjects.path);
  Samples ab_tree_us;
  std::vector<spm::Contact> contacts(1u << 16);
  for (const SurfacePose& pose : subjects.path) {
    double min = 1e300;
    std::uint32_t count = 0;
    for (int round = 0; round < 3; ++round) {
      Stopwatch watch;
      count = finest.tree().find_contacts(pose.centre, subjects.radius, contacts.data(),
                                          static_cast<std::uint32_t>(contacts.size()));
      min = std::min(min, watch.lap());
    }
    ab_tree_us.add(min);
    std::vector<std::uint32_t> faces;
    for (std::uint32_t i = 0; i < count; ++i) faces.push_back(index(contacts[i].face));
    std::sort(faces.begin(), faces.end());
    subjects.touched.push_back(std::move(faces));
  }

  char text[128];
  std::snprintf(text, sizeof text,
                "sphere of 3 mm and stylus of 720 triangles, %zu poses at distances of %g mm, seed 1",
                subjects.path.size(), settings.step * 1e3);
  Report report{{subject.name, subject.model.summary.digest, subject.model.summary.faces, text}};
  report.add_percentiles("sphere: time of a query with tests of triangles", "queries, AB-tree with vector instructions",
                         "us", ab_tree_us);
  measure<SlabVolume<3>>(subjects, report);
  measure<SphereVolume>(subjects, report);
  measure<SlabVolume<9>>(subjects, report);
  measure<OrientedVolume>(subjects, report);
  return report;
}

}  // namespace
}  // namespace tactus::bench

int main(int argc, char** argv) {
  tactus::bench::Settings settings;
  tactus::bench::App app{"volumes", "Compares bounding volumes for the AB-tree over the finest mesh",
                         "200 poses, for CI"};
  app.add_option("--model", settings.model, "mesh file of any format, or .spm model (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 10000000u));
  CLI::Option* poses =
      app.add_option("--poses", settings.poses, "number of poses of the path")->check(CLI::Range(10u, 100000u));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick && poses->count() == 0) settings.poses = 200;
    return tactus::bench::run(settings);
  });
}
