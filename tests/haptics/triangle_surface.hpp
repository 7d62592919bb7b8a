/// A surface that is a list of triangles, and shapes for the tests of the proxy and of simulated operators.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "haptics/surface.hpp"

namespace tactus::haptics::testing {

using Triangle = std::array<Vec3d, 3>;

class TriangleSurface : public Surface {
 public:
  TriangleSurface() = default;
  explicit TriangleSurface(std::vector<Triangle> triangles) : triangles_{std::move(triangles)} {
    blocks_.resize((triangles_.size() + kBlock - 1) / kBlock);
    for (std::size_t i = 0; i < triangles_.size(); ++i) {
      for (const Vec3d& corner : triangles_[i]) blocks_[i / kBlock].extend(corner);
    }
  }

  [[nodiscard]] bool sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept override {
    const Vec3d low = from.cwiseMin(to).array() - radius;
    const Vec3d high = from.cwiseMax(to).array() + radius;
    const Eigen::AlignedBox3d path{low, high};
    FirstTouch first{from, to, radius};
    for (std::size_t i = 0; i < triangles_.size(); ++i) {
      if (i % kBlock == 0 && !blocks_[i / kBlock].intersects(path)) {
        i += kBlock - 1;
        continue;
      }
      const auto& [a, b, c] = triangles_[i];
      if ((a.cwiseMin(b).cwiseMin(c).array() > high.array()).any()) continue;
      if ((a.cwiseMax(b).cwiseMax(c).array() < low.array()).any()) continue;
      first.add_triangle(a, b, c, 0, static_cast<std::uint32_t>(i));
    }
    return first.result(hit);
  }

  [[nodiscard]] bool closest(const Vec3d& point, double max_distance, SurfaceHit& hit) const noexcept override {
    ClosestSide side{point, max_distance};
    for (std::size_t i = 0; i < triangles_.size(); ++i) {
      if (i % kBlock == 0 && blocks_[i / kBlock].exteriorDistance(point) > side.reach() * (1 + 1e-9)) {
        i += kBlock - 1;
        continue;
      }
      const auto& [a, b, c] = triangles_[i];
      const Vec3d nearest = point.cwiseMax(a.cwiseMin(b).cwiseMin(c)).cwiseMin(a.cwiseMax(b).cwiseMax(c));
      if ((nearest - point).norm() > side.reach() * (1 + 1e-9)) continue;
      side.add_triangle(a, b, c, 0, static_cast<std::uint32_t>(i));
    }
    return side.result(hit);
  }

  [[nodiscard]] const std::vector<Triangle>& triangles() const { return triangles_; }

 private:
  static constexpr std::size_t kBlock = 16;
  std::vector<Triangle> triangles_;
  /// Bounding boxes of blocks of kBlock consecutive triangles. In the shapes below such triangles are close together,
  /// so a query can skip most blocks.
  std::vector<Eigen::AlignedBox3d> blocks_;
};

/// Winding number of a closed surface around a point: the sum of the solid angles of its triangles over 4 pi, 1 inside
/// and 0 outside. The computation uses no normals and no closest points. Source: Van Oosterom, Strackee 1983.
inline double winding_number(const Vec3d& p, const std::vector<Triangle>& triangles) {
  double sum = 0;
  for (const Triangle& t : triangles) {
    const Vec3d a = t[0] - p;
    const Vec3d b = t[1] - p;
    const Vec3d c = t[2] - p;
    const double la = a.norm();
    const double lb = b.norm();
    const double lc = c.norm();
    const double cosine = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
    sum += 2 * std::atan2(a.dot(b.cross(c)), cosine);
  }
  return sum / (4 * 3.14159265358979323846);
}

inline std::vector<Triangle> tetrahedron(double size) {
  const Vec3d a{size, size, size};
  const Vec3d b{size, -size, -size};
  const Vec3d c{-size, size, -size};
  const Vec3d d{-size, -size, size};
  return {{a, b, c}, {a, c, d}, {a, d, b}, {b, d, c}};
}

/// An octahedron that is subdivided `levels` times and projected onto a sphere: 8 * 4^levels triangles, facing
/// outwards.
inline std::vector<Triangle> sphere(double radius, int levels) {
  const Vec3d x = Vec3d::UnitX();
  const Vec3d y = Vec3d::UnitY();
  const Vec3d z = Vec3d::UnitZ();
  std::vector<Triangle> triangles{{x, y, z},  {y, -x, z},  {-x, -y, z},  {-y, x, z},
                                  {y, x, -z}, {-x, y, -z}, {-y, -x, -z}, {x, -y, -z}};
  for (int level = 0; level < levels; ++level) {
    std::vector<Triangle> finer;
    for (const auto& [a, b, c] : triangles) {
      // a + b and b + a are equal bit for bit, so adjacent triangles get the same corner.
      const Vec3d ab = (a + b).normalized();
      const Vec3d bc = (b + c).normalized();
      const Vec3d ca = (c + a).normalized();
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    triangles = std::move(finer);
  }
  for (Triangle& t : triangles) {
    for (Vec3d& corner : t) corner *= radius;
  }
  return triangles;
}

/// A sphere with bumps and hollows. Its radius is `radius` * (1 + `height` * w), with w between -1.7 and 1.7.
inline std::vector<Triangle> bumpy(double radius, int levels, double height) {
  std::vector<Triangle> triangles = sphere(1, levels);
  for (Triangle& t : triangles) {
    for (Vec3d& p : t) {
      const double wave = std::sin(5 * p.x() + 1) * std::sin(6 * p.y()) + std::sin(7 * p.z() + 2) * 0.7;
      p *= radius * (1 + height * wave);
    }
  }
  return triangles;
}

/// A flat square of edge `size` at height z around the origin, normal up, in two triangles.
inline std::vector<Triangle> square(double size, double z) {
  const double h = size / 2;
  return {{Vec3d{-h, -h, z}, Vec3d{h, -h, z}, Vec3d{h, h, z}}, {Vec3d{-h, -h, z}, Vec3d{h, h, z}, Vec3d{-h, h, z}}};
}

/// A rectangle with the given corner and the edges u and v from this corner. The normal is u x v.
inline std::vector<Triangle> sheet(const Vec3d& corner, const Vec3d& u, const Vec3d& v) {
  return {{corner, corner + u, corner + u + v}, {corner, corner + u + v, corner + v}};
}

inline std::vector<Triangle> operator+(std::vector<Triangle> a, const std::vector<Triangle>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

}  // namespace tactus::haptics::testing
