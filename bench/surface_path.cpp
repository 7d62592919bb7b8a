#include "bench/surface_path.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

namespace tactus::bench {

namespace {

using spm::kNone;
using spm::Vec3d;

/// Returns for each face the neighbours across its edges; edge i begins at corner i. kNone if an edge does not have
/// exactly two faces.
std::vector<std::array<std::uint32_t, 3>> neighbours(std::span<const std::array<std::uint32_t, 3>> faces) {
  struct Edge {
    std::uint32_t low, high, face, side;
  };
  std::vector<Edge> edges;
  edges.reserve(3 * faces.size());
  for (std::uint32_t f = 0; f < faces.size(); ++f) {
    for (std::uint32_t i = 0; i < 3; ++i) {
      const auto [low, high] = std::minmax(faces[f][i], faces[f][(i + 1) % 3]);
      edges.push_back({low, high, f, i});
    }
  }
  std::sort(edges.begin(), edges.end(),
            [](const Edge& a, const Edge& b) { return a.low != b.low ? a.low < b.low : a.high < b.high; });
  std::vector<std::array<std::uint32_t, 3>> across(faces.size(), {kNone, kNone, kNone});
  for (std::size_t first = 0, last = 0; first < edges.size(); first = last) {
    while (last < edges.size() && edges[last].low == edges[first].low && edges[last].high == edges[first].high) ++last;
    if (last - first != 2) continue;
    across[edges[first].face][edges[first].side] = edges[first + 1].face;
    across[edges[first + 1].face][edges[first + 1].side] = edges[first].face;
  }
  return across;
}

/// Returns a face of the component with the most faces.
std::uint32_t face_of_largest_component(const std::vector<std::array<std::uint32_t, 3>>& across) {
  std::vector<bool> seen(across.size(), false);
  std::vector<std::uint32_t> component;
  std::size_t largest = 0;
  std::uint32_t face = 0;
  for (std::uint32_t start = 0; start < across.size(); ++start) {
    if (seen[start]) continue;
    component.assign(1, start);
    seen[start] = true;
    for (std::size_t next = 0; next < component.size(); ++next) {
      for (const std::uint32_t neighbour : across[component[next]]) {
        if (neighbour == kNone || seen[neighbour]) continue;
        seen[neighbour] = true;
        component.push_back(neighbour);
      }
    }
    if (component.size() <= largest) continue;
    largest = component.size();
    face = start;
  }
  return face;
}

/// A point that moves on geodesics of a mesh.
class Walker {
 public:
  Walker(std::span<const std::array<float, 3>> vertices, std::span<const std::array<std::uint32_t, 3>> faces,
         std::uint64_t seed)
      : vertices_{vertices},
        faces_{faces},
        across_{neighbours(faces)},
        rng_{seed},
        face_{face_of_largest_component(across_)} {
    point_ = (corner(face_, 0) + corner(face_, 1) + corner(face_, 2)) / 3;
    turn_to_random();
  }

  [[nodiscard]] const Vec3d& point() const noexcept { return point_; }
  [[nodiscard]] Vec3d normal() const {
    return (corner(face_, 1) - corner(face_, 0)).cross(corner(face_, 2) - corner(face_, 0)).normalized();
  }

  /// Moves the point by `length` along the surface.
  void advance(double length) {
    constexpr int kMaxCrossings = 1000;  // of edges in a row; a point with more crossings circles around a vertex
    constexpr int kMaxTurns = 100;
    for (int turns = 0; turns < kMaxTurns; ++turns) {
      for (int crossings = 0; crossings < kMaxCrossings; ++crossings) {
        const Exit exit = find_exit();
        if (exit.after >= length) {
          point_ += direction_ * length;
          return;
        }
        point_ += direction_ * exit.after;
        length -= exit.after;
        cross(exit.side);
      }
      turn_to_random();
    }
    throw std::runtime_error("surface path: the point cannot leave face " + std::to_string(face_));
  }

  /// Turns by `angle` radians about the face's normal.
  void turn(double angle) {
    direction_ = (std::cos(angle) * direction_ + std::sin(angle) * normal().cross(direction_)).normalized();
  }

 private:
  struct Exit {
    double after = std::numeric_limits<double>::infinity();
    int side = 0;
  };

  [[nodiscard]] Vec3d corner(std::uint32_t face, int i) const {
    const std::array<float, 3>& p = vertices_[faces_[face][i % 3]];
    return {p[0], p[1], p[2]};
  }

  /// Returns the unit vector in the plane of `face`, perpendicular to its edge `side`, towards the third corner.
  [[nodiscard]] Vec3d inward(std::uint32_t face, int side) const {
    const Vec3d along = (corner(face, side + 1) - corner(face, side)).normalized();
    const Vec3d to_third = corner(face, side + 2) - corner(face, side);
    return (to_third - along * along.dot(to_third)).normalized();
  }

  [[nodiscard]] Exit find_exit() const {
    Exit exit;
    for (int side = 0; side < 3; ++side) {
      const Vec3d in = inward(face_, side);
      const double closing = -in.dot(direction_);
      if (closing <= 0) continue;
      const double after = std::max(0.0, in.dot(point_ - corner(face_, side)) / closing);
      if (after < exit.after) exit = {after, side};
    }
    return exit;
  }

  void cross(int side) {
    const Vec3d along = (corner(face_, side + 1) - corner(face_, side)).normalized();
    const double along_edge = direction_.dot(along);
    const double across_edge = std::sqrt(std::max(0.0, 1 - along_edge * along_edge));
    const std::uint32_t neighbour = across_[face_][side];
    if (neighbour == kNone) {
      direction_ = (along * along_edge + inward(face_, side) * across_edge).normalized();
      return;
    }
    int back = 0;
    while (across_[neighbour][back] != face_) ++back;
    face_ = neighbour;
    direction_ = (along * along_edge + inward(face_, back) * across_edge).normalized();
  }

  void turn_to_random() {
    direction_ = (corner(face_, 1) - corner(face_, 0)).normalized();
    turn(std::uniform_real_distribution<double>{0, 2 * 3.14159265358979}(rng_));
  }

  std::span<const std::array<float, 3>> vertices_;
  std::span<const std::array<std::uint32_t, 3>> faces_;
  std::vector<std::array<std::uint32_t, 3>> across_;
  std::mt19937_64 rng_;
  std::uint32_t face_;
  Vec3d point_ = Vec3d::Zero();
  Vec3d direction_ = Vec3d::Zero();
};

/// A random function of time of variance 1 whose spectrum is flat up to `band` and empty above.
class BandNoise {
 public:
  BandNoise(double band, std::mt19937_64& rng) {
    constexpr double kTwoPi = 2 * 3.14159265358979;
    std::uniform_real_distribution<double> unit{0, 1};
    for (std::size_t i = 0; i < kTones; ++i)  // one tone in each of kTones bands of equal width
      tones_[i] = {kTwoPi * band * (static_cast<double>(i) + unit(rng)) / kTones, kTwoPi * unit(rng)};
  }
  [[nodiscard]] double operator()(double time) const {
    double sum = 0;
    for (const Tone& tone : tones_) sum += std::cos(tone.rate * time + tone.phase);
    return sum * std::sqrt(2.0 / kTones);
  }

 private:
  static constexpr std::size_t kTones = 64;
  struct Tone {
    double rate, phase;
  };
  std::array<Tone, kTones> tones_;
};

struct Plane {
  Vec3d mean, normal;
  [[nodiscard]] Vec3d project(const Vec3d& point) const { return point - normal * normal.dot(point - mean); }
};

/// A surface without details smaller than `reach`. Fits a plane to the vertices around a point, weighted by distance.
class SmoothedSurface {
 public:
  SmoothedSurface(std::span<const std::array<float, 3>> vertices, double reach) : reach_{reach} {
    constexpr std::size_t kSamples = 6000;
    const std::size_t every = std::max<std::size_t>(1, vertices.size() / kSamples);
    for (std::size_t v = 0; v < vertices.size(); v += every)
      samples_.emplace_back(vertices[v][0], vertices[v][1], vertices[v][2]);
  }

  [[nodiscard]] Plane at(const Vec3d& point) const {
    double reach = reach_;
    for (;; reach *= 2) {
      double weights = 0;
      Vec3d mean = Vec3d::Zero();
      Eigen::Matrix3d square = Eigen::Matrix3d::Zero();
      for (const Vec3d& sample : samples_) {
        const Vec3d from = sample - point;
        const double near = 1 - from.squaredNorm() / (reach * reach);
        if (near <= 0) continue;
        const double weight = near * near;
        weights += weight;
        mean += weight * from;
        square += weight * from * from.transpose();
      }
      if (weights < 3) continue;
      mean /= weights;
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
      solver.computeDirect(square / weights - mean * mean.transpose());
      return {point + mean, solver.eigenvectors().col(0)};
    }
  }

 private:
  double reach_;
  std::vector<Vec3d> samples_;
};

constexpr double kHandSmoothing = 8;  // tip radii; a hand moves past smaller bumps along the smoothed surface

}  // namespace

std::vector<SurfacePose> surface_poses(std::span<const std::array<float, 3>> vertices,
                                       std::span<const std::array<std::uint32_t, 3>> faces,
                                       const PathSettings& settings,
                                       const std::function<double(const Vec3d&)>& distance) {
  constexpr double kTurnEvery = 5;  // tip radii between changes of the path's curvature
  Walker walker{vertices, faces, settings.seed};
  std::mt19937_64 rng{settings.seed + 1};
  std::uniform_real_distribution<double> curvature{-0.1 / settings.radius, 0.1 / settings.radius};
  const double stand_off = settings.radius - settings.depth;
  const double smoothing = std::min(1.0, settings.step / settings.radius);
  const auto turn_every = static_cast<std::uint64_t>(std::max(1.0, kTurnEvery * settings.radius / settings.step));

  Vec3d normal = walker.normal();
  const auto centre_above_point = [&] {
    normal = ((1 - smoothing) * normal + smoothing * walker.normal()).normalized();
    Vec3d centre = walker.point() + normal * stand_off;
    for (int i = 0; i < 20; ++i) {
      const double too_near = stand_off - distance(centre);
      if (too_near < 1e-3 * settings.depth) break;
      centre += normal * too_near;
    }
    return centre;
  };

  std::vector<SurfacePose> path;
  path.reserve(settings.poses);
  Vec3d from = centre_above_point();
  path.push_back({from, normal});
  double since_last_pose = 0;  // length
  double bend = 0;
  for (std::uint64_t i = 0; path.size() < settings.poses; ++i) {
    if (i % turn_every == 0) bend = curvature(rng);
    walker.turn(bend * settings.step);
    walker.advance(settings.step);
    const Vec3d to = centre_above_point();
    const double length = (to - from).norm();
    double at = settings.step - since_last_pose;
    for (; at <= length && path.size() < settings.poses; at += settings.step) {
      path.push_back({from + (to - from) * (at / length), normal});
    }
    since_last_pose = length - (at - settings.step);
    from = to;
  }
  return path;
}

std::vector<Vec3d> surface_path(std::span<const std::array<float, 3>> vertices,
                                std::span<const std::array<std::uint32_t, 3>> faces, const PathSettings& settings,
                                const std::function<double(const Vec3d&)>& distance) {
  std::vector<Vec3d> centres;
  for (const SurfacePose& pose : surface_poses(vertices, faces, settings, distance)) centres.push_back(pose.centre);
  return centres;
}

std::vector<Vec3d> hand_path(std::span<const std::array<float, 3>> vertices, const Vec3d& start,
                             const HandPathSettings& settings, const std::function<Vec3d(const Vec3d&)>& nearest) {
  constexpr double kLiftBand = 1;      // Hz
  constexpr double kLiftAbove = 0.43;  // a standard normal variable exceeds this value a third of the time
  std::mt19937_64 rng{settings.seed};
  const BandNoise bend{settings.band, rng}, lift{kLiftBand, rng};
  const double stand_off = settings.radius - settings.depth;
  const SmoothedSurface smoothed{vertices, kHandSmoothing * settings.radius};

  std::vector<Vec3d> path;
  path.reserve(settings.poses);
  Vec3d tip = start;
  Vec3d normal = smoothed.at(start).normal;
  if (normal.dot(start - nearest(start)) < 0) normal = -normal;
  Vec3d tangent = normal.unitOrthogonal();
  for (std::uint32_t i = 0; i < settings.poses; ++i) {
    const double time = i * settings.period;
    const double turn = bend(time) * settings.speed * settings.period / settings.bend_radius;
    tangent = std::cos(turn) * tangent + std::sin(turn) * normal.cross(tangent);
    tip += settings.speed * settings.period * tangent;
    const Vec3d next = smoothed.at(tip).normal;
    normal = next.dot(normal) < 0 ? Vec3d{-next} : next;
    tangent = (tangent - normal * normal.dot(tangent)).normalized();
    for (int tries = 0; tries < 20; ++tries) {
      const Vec3d away = tip - nearest(tip);
      const double off = stand_off - (away.dot(normal) < 0 ? -1 : 1) * away.norm();
      if (std::abs(off) < 0.05 * settings.depth) break;
      tip += off * normal;
    }
    path.push_back(tip + normal * (settings.height * std::max(0.0, lift(time) - kLiftAbove)));
  }
  return path;
}

}  // namespace tactus::bench
