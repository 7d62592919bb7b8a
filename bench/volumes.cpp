// What other bounding volumes would do in the AB-tree: spheres, boxes, 18-DOPs and oriented boxes in the same
// eight-wide implicit tree over the finest faces, along the same path, with the same tests of triangles.
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

/// The tree whose node `id` of level l is over the faces from id * 8^l on; level 1 is levels_[0].
template <class Volume>
class Tree {
 public:
  explicit Tree(const Triangles& triangles) : triangles_{triangles} {
    for (std::size_t count = triangles.size(); count > 1 || levels_.empty();) {
      count = (count + kWidth - 1) / kWidth;
      levels_.emplace_back(count);
      for (std::uint32_t id = 0; id < count; ++id) make(levels_.size() - 1, id, nullptr);
    }
  }
  [[nodiscard]] std::size_t height() const { return levels_.size(); }
  [[nodiscard]] const std::vector<Volume>& nodes(std::size_t level) const { return levels_[level]; }
  /// Of a node of `level`, one level down: nodes, or faces below level 0.
  [[nodiscard]] std::uint32_t end_of_children(std::size_t level, std::uint32_t id) const {
    const std::size_t below = level == 0 ? triangles_.size() : levels_[level - 1].size();
    return static_cast<std::uint32_t>(std::min<std::size_t>(below, kWidth * (std::size_t{id} + 1)));
  }

  /// The volumes of all nodes above these faces anew; returns how many. `faces` ascend.
  std::uint32_t refit(std::vector<std::uint32_t> faces) {
    std::uint32_t made = 0;
    for (std::size_t level = 0; level < levels_.size(); ++level) {
      for (std::uint32_t& id : faces) id /= kWidth;
      faces.erase(std::unique(faces.begin(), faces.end()), faces.end());
      for (const std::uint32_t id : faces) {
        const Volume before = levels_[level][id];
        make(level, id, &before);
      }
      made += static_cast<std::uint32_t>(faces.size());
    }
    return made;
  }

  /// Faces below nodes whose volumes meet the ball; returns how many volumes were asked.
  std::uint32_t near(const Vec3d& centre, double radius, std::vector<std::uint32_t>& faces) const {
    std::uint32_t requested = 0;
    visit(height() - 1, 0, centre, radius, requested, faces);
    return requested;
  }

 private:
  void make(std::size_t level, std::uint32_t id, const Volume* like) {
    const std::uint32_t first = kWidth * id, end = end_of_children(level, id);
    if (level == 0) {
      const Points points{triangles_[first].data(), 3 * std::size_t{end - first}};
      levels_[level][id] = Volume::of(points);
    } else {
      levels_[level][id] =
          Volume::over(std::span<const Volume>{levels_[level - 1].data() + first, std::size_t{end - first}}, like);
    }
  }
  void visit(std::size_t level, std::uint32_t id, const Vec3d& centre, double radius, std::uint32_t& requested,
             std::vector<std::uint32_t>& faces) const {
    ++requested;
    if (!levels_[level][id].meets_sphere(centre, radius)) return;
    for (std::uint32_t child = kWidth * id; child < end_of_children(level, id); ++child) {
      if (level == 0)
        faces.push_back(child);
      else
        visit(level - 1, child, centre, radius, requested, faces);
    }
  }

  const Triangles& triangles_;
  std::vector<std::vector<Volume>> levels_;
};

/// The probe's tree, its nodes taken into the model's frame for each pose.
template <class Volume>
class ProbePairs {
 public:
  ProbePairs(const Tree<Volume>& model, const Tree<Volume>& probe)
      : model_{model}, probe_{probe}, moved_(probe.height()) {}
  /// Pairs of nodes of level 1 whose volumes meet; returns how many pairs of volumes were asked.
  std::uint32_t find(const Eigen::Isometry3d& pose, std::vector<std::array<std::uint32_t, 2>>& leaves) {
    for (std::size_t level = 0; level < moved_.size(); ++level) {
      moved_[level].clear();
      for (const Volume& volume : probe_.nodes(level)) moved_[level].push_back(volume.moved(pose));
    }
    requested_ = 0;
    visit(model_.height() - 1, 0, probe_.height() - 1, 0, leaves);
    return requested_;
  }

 private:
  void visit(std::size_t a, std::uint32_t i, std::size_t b, std::uint32_t j,
             std::vector<std::array<std::uint32_t, 2>>& leaves) {
    ++requested_;
    if (!model_.nodes(a)[i].meets(moved_[b][j])) return;
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
  std::uint32_t requested_ = 0;
};

struct Subjects {
  double radius;  // file units
  Triangles model, stylus;
  std::vector<SurfacePose> path;
  std::vector<Eigen::Isometry3d> poses;
  std::vector<std::vector<std::uint32_t>> touched;  // by pose: faces, by the tree of the project
  std::vector<std::uint32_t> pairs;                 // by pose: triangles of the stylus and the model that meet

  /// Below two nodes of level 1.
  [[nodiscard]] std::uint32_t meeting(std::uint32_t node, std::uint32_t of_stylus,
                                      const Eigen::Isometry3d& pose) const {
    std::uint32_t count = 0;
    for (std::size_t b = kWidth * of_stylus; b < std::min<std::size_t>(stylus.size(), kWidth * (of_stylus + 1)); ++b) {
      const std::array<Vec3d, 3> moved{pose * stylus[b][0], pose * stylus[b][1], pose * stylus[b][2]};
      for (std::size_t a = kWidth * node; a < std::min<std::size_t>(model.size(), kWidth * (node + 1)); ++a) {
        spm::PairContact contact;
        count += spm::meet(model[a], moved, contact) ? 1 : 0;
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
  std::uint64_t wrong = 0;
  std::vector<std::uint32_t> faces, touched;
  std::vector<std::array<std::uint32_t, 2>> leaves;
  constexpr int kRounds = 3;  // the least of their times: more is the machine's other work
  for (std::size_t pose = 0; pose < subjects.path.size(); ++pose) {
    double sphere = 1e300, both = 1e300, refit = 1e300;
    std::uint32_t requested = 0, requested_pairs = 0, made = 0, meeting = 0;
    for (int round = 0; round < kRounds; ++round) {
      faces.clear();
      touched.clear();
      leaves.clear();
      Stopwatch watch;
      const Vec3d& centre = subjects.path[pose].centre;
      requested = tree.near(centre, subjects.radius, faces);
      for (const std::uint32_t face : faces) {
        const auto& t = subjects.model[face];
        if (spm::closest_point(centre, t[0], t[1], t[2]).squared_distance <= subjects.radius * subjects.radius)
          touched.push_back(face);
      }
      sphere = std::min(sphere, watch.lap());
      requested_pairs = probe.find(subjects.poses[pose], leaves);
      both = std::min(both, watch.lap());
      made = tree.refit(touched);
      refit = std::min(refit, watch.lap());
    }
    // The triangles' own tests are the same for all volumes, so they are not timed, and not done everywhere.
    if (pose % 20 == 0)
      for (const auto& [i, j] : leaves) meeting += subjects.meeting(i, j, subjects.poses[pose]);
    if (subjects.pairs.size() == pose) subjects.pairs.push_back(meeting);
    wrong += touched != subjects.touched[pose] || meeting != subjects.pairs[pose] ? 1 : 0;
    volumes.add(requested);
    triangles.add(static_cast<double>(faces.size()));
    sphere_us.add(sphere);
    pair_volumes.add(requested_pairs);
    pair_leaves.add(static_cast<double>(leaves.size()));
    stylus_us.add(both);
    if (made > 0) {
      nodes.add(made);
      node_ns.add(refit * 1000 / made);
    }
  }
  report.figure("floats of a volume", name, "", sizeof(Volume) / sizeof(float));
  report.row("ball: volumes asked", name, "", volumes);
  report.row("ball: triangles asked", name, "", triangles);
  report.row("ball: time, triangles included", name, "us", sphere_us);
  report.row("stylus: pairs of volumes asked", name, "", pair_volumes);
  report.row("stylus: pairs of eight triangles left", name, "", pair_leaves);
  report.row("stylus: time, triangles not included", name, "us", stylus_us);
  report.row("refit of the touched faces: nodes", name, "", nodes);
  report.row("refit of the touched faces: per node", name, "ns", node_ns);
  report.at_most("other contacts than the AB-tree's or the first volume's", name, "poses", static_cast<double>(wrong),
                 0);
}

Report run(const Settings& settings) {
  std::fprintf(stderr, "making the model\n");
  const LoadedModel subject = load_model(settings.model, settings.faces);
  const double unit = subject.model.summary.metres_per_unit;
  const spm::FinestTree finest{subject.model.positions, subject.finest};
  spm::offline::TriangleMesh stylus = stylus_in(unit);
  std::vector<std::array<std::uint32_t, 3>> ordered;
  for (const std::uint32_t face : face_order(stylus)) ordered.push_back(stylus.faces[face]);
  Subjects subjects{kRadius / unit,
                    triangles_of(subject.model.positions, subject.finest),
                    triangles_of(stylus.positions, ordered),
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
  Samples shipped;
  std::vector<spm::Contact> contacts(1u << 16);
  for (const SurfacePose& pose : subjects.path) {
    double min = 1e300;
    std::uint32_t count = 0;
    for (int round = 0; round < 3; ++round) {
      Stopwatch watch;
      count = finest.tree().touching(pose.centre, subjects.radius, contacts.data(),
                                     static_cast<std::uint32_t>(contacts.size()));
      min = std::min(min, watch.lap());
    }
    shipped.add(min);
    std::vector<std::uint32_t> faces;
    for (std::uint32_t i = 0; i < count; ++i) faces.push_back(index(contacts[i].face));
    std::sort(faces.begin(), faces.end());
    subjects.touched.push_back(std::move(faces));
  }

  char text[128];
  std::snprintf(text, sizeof text, "ball of 3 mm and stylus of 720 triangles, %zu poses %g mm apart, seed 1",
                subjects.path.size(), settings.step * 1e3);
  Report report{{subject.name, subject.model.summary.digest, subject.model.summary.faces, text}};
  report.row("ball: time", "the AB-tree, eight boxes at once", "us", shipped);
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
  tactus::bench::App app{"volumes", "Other bounding volumes in the AB-tree's place, over the finest mesh",
                         "200 poses, for CI"};
  app.add_option("--model", settings.model, "model file of any kind, or .spm (default: a generated organ)")
      ->check(CLI::ExistingFile);
  app.add_option("--faces", settings.faces, "faces of the generated organ")->check(CLI::Range(1000u, 10000000u));
  CLI::Option* poses = app.add_option("--poses", settings.poses, "of the path")->check(CLI::Range(10u, 100000u));
  return tactus::bench::bench_main(app, argc, argv, [&] {
    if (app.quick && poses->count() == 0) settings.poses = 200;
    return tactus::bench::run(settings);
  });
}
