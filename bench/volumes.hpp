/// Bounding volumes for the nodes of a tree like the AB-tree. Each is computed from its points or child volumes, as
/// refit does.
///
/// The code is scalar, because it compares only these volumes with each other; spm/lanes uses vector instructions.
/// Volumes are stored as floats and enlarged by more than the rounding error, so that no overlap is missed. Any frame.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>

#include "spm/model.hpp"

namespace tactus::bench {

using spm::Vec3d;
using Points = std::span<const Vec3d>;

/// Each volume class has:
///   of(points)                      returns the volume around the points
///   over(children, previous)        returns the volume around the children with the axes of `previous`; null: new axes
///   moved(pose)                     returns a volume in another frame that contains this one
///   overlaps_sphere(centre, radius), overlaps(other)   return false only if there is no overlap
struct SphereVolume {
  static constexpr const char* kName = "sphere";
  std::array<float, 3> centre;
  float radius;

  static SphereVolume of(Points points) {
    Eigen::AlignedBox3d box;
    for (const Vec3d& p : points) box.extend(p);
    double radius = 0;
    for (const Vec3d& p : points) radius = std::max(radius, (p - box.center()).norm());
    return make(box.center(), radius);
  }
  static SphereVolume over(std::span<const SphereVolume> children, const SphereVolume* /*previous*/) {
    Eigen::AlignedBox3d box;
    for (const SphereVolume& child : children) {
      box.extend(child.middle() - Vec3d::Constant(child.radius));
      box.extend(child.middle() + Vec3d::Constant(child.radius));
    }
    double radius = 0;
    for (const SphereVolume& child : children)
      radius = std::max(radius, (child.middle() - box.center()).norm() + child.radius);
    return make(box.center(), radius);
  }
  [[nodiscard]] SphereVolume moved(const Eigen::Isometry3d& pose) const { return make(pose * middle(), radius); }
  [[nodiscard]] bool overlaps_sphere(const Vec3d& at, double reach) const {
    const double sum = reach + radius;
    return (at - middle()).squaredNorm() <= sum * sum;
  }
  [[nodiscard]] bool overlaps(const SphereVolume& other) const { return overlaps_sphere(other.middle(), other.radius); }

 private:
  static SphereVolume make(const Vec3d& centre, double radius) {
    return {{static_cast<float>(centre[0]), static_cast<float>(centre[1]), static_cast<float>(centre[2])},
            static_cast<float>(radius * (1 + 1e-6) + centre.cwiseAbs().maxCoeff() * 4e-7)};
  }
  [[nodiscard]] Vec3d middle() const { return {centre[0], centre[1], centre[2]}; }
};

/// Volume between pairs of parallel planes. 3 directions make a box. 9 directions, the axes and face diagonals of a
/// cube, make an 18-DOP.
template <int kDirections>
struct SlabVolume {
  static constexpr const char* kName = kDirections == 3 ? "box" : "18-DOP";
  std::array<float, kDirections> low, high;

  static SlabVolume of(Points points) {
    SlabVolume volume = none();
    for (const Vec3d& p : points)
      for (int d = 0; d < kDirections; ++d) volume.extend(d, along(d, p), along(d, p), p.cwiseAbs().sum() * 2e-7);
    return volume;
  }
  static SlabVolume over(std::span<const SlabVolume> children, const SlabVolume* /*previous*/) {
    SlabVolume volume = none();
    for (const SlabVolume& child : children)
      for (std::size_t d = 0; d < kDirections; ++d) {
        volume.low[d] = std::min(volume.low[d], child.low[d]);
        volume.high[d] = std::max(volume.high[d], child.high[d]);
      }
    return volume;
  }
  [[nodiscard]] SlabVolume moved(const Eigen::Isometry3d& pose) const {
    std::array<Vec3d, 8> corners;
    for (std::size_t i = 0; i < 8; ++i)
      corners[i] = pose * Vec3d{(i & 1) != 0 ? high[0] : low[0], (i & 2) != 0 ? high[1] : low[1],
                                (i & 4) != 0 ? high[2] : low[2]};
    return of(Points{corners.data(), corners.size()});
  }
  [[nodiscard]] bool overlaps_sphere(const Vec3d& at, double reach) const {
    double squared = 0;
    for (std::size_t d = 0; d < 3; ++d) {
      const double apart = std::max({low[d] - at[static_cast<int>(d)], at[static_cast<int>(d)] - high[d], 0.0});
      squared += apart * apart;
    }
    if (squared > reach * reach) return false;
    for (int d = 3; d < kDirections; ++d) {
      const double x = along(d, at), wide = reach * std::sqrt(2.0);
      if (x + wide < low[static_cast<std::size_t>(d)] || x - wide > high[static_cast<std::size_t>(d)]) return false;
    }
    return true;
  }
  [[nodiscard]] bool overlaps(const SlabVolume& other) const {
    for (std::size_t d = 0; d < kDirections; ++d)
      if (low[d] > other.high[d] || other.low[d] > high[d]) return false;
    return true;
  }

 private:
  static SlabVolume none() {
    SlabVolume volume;
    volume.low.fill(std::numeric_limits<float>::infinity());
    volume.high.fill(-std::numeric_limits<float>::infinity());
    return volume;
  }
  static double along(int d, const Vec3d& p) {
    if (d < 3) return p[d];
    const int a = d % 3, b = (d + 1) % 3;
    return d < 6 ? p[a] + p[b] : p[a] - p[b];
  }
  void extend(int direction, double from, double to, double margin) {
    const auto d = static_cast<std::size_t>(direction);
    low[d] = std::min(low[d], static_cast<float>(from - margin));
    high[d] = std::max(high[d], static_cast<float>(to + margin));
  }
};

/// Box with its own axes, the principal axes of the points.
struct OrientedVolume {
  static constexpr const char* kName = "oriented box";
  std::array<float, 3> centre, half;
  std::array<float, 9> axes;  // columns

  static OrientedVolume of(Points points) { return around(points, axes_of(points)); }
  static OrientedVolume over(std::span<const OrientedVolume> children, const OrientedVolume* previous) {
    std::array<Vec3d, 64> corners;
    std::size_t count = 0;
    for (const OrientedVolume& child : children)
      for (int i = 0; i < 8; ++i) {
        const Vec3d sign{(i & 1) != 0 ? 1.0 : -1.0, (i & 2) != 0 ? 1.0 : -1.0, (i & 4) != 0 ? 1.0 : -1.0};
        corners[count++] = child.middle() + child.matrix() * sign.cwiseProduct(child.extent());
      }
    const Points all{corners.data(), count};
    return around(all, previous != nullptr ? previous->matrix() : axes_of(all));
  }
  [[nodiscard]] OrientedVolume moved(const Eigen::Isometry3d& pose) const {
    return make(pose * middle(), extent(), pose.linear() * matrix());
  }
  [[nodiscard]] bool overlaps_sphere(const Vec3d& at, double reach) const {
    const Vec3d apart = ((matrix().transpose() * (at - middle())).cwiseAbs() - extent()).cwiseMax(0.0);
    return apart.squaredNorm() <= reach * reach;
  }
  /// Source: Gottschalk, Lin, Manocha 1996 (fifteen separating axes).
  [[nodiscard]] bool overlaps(const OrientedVolume& other) const {
    const Eigen::Matrix3d axes_in_frame = matrix();
    const Eigen::Matrix3d r = axes_in_frame.transpose() * other.matrix();
    const Eigen::Matrix3d size = r.cwiseAbs() + Eigen::Matrix3d::Constant(1e-6);
    const Vec3d t = axes_in_frame.transpose() * (other.middle() - middle()), a = extent(), b = other.extent();
    for (int i = 0; i < 3; ++i) {
      if (std::abs(t[i]) > a[i] + size.row(i).dot(b)) return false;
      if (std::abs(t.dot(r.col(i))) > size.col(i).dot(a) + b[i]) return false;
    }
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) {
        const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
        const double reach = a[i1] * size(i2, j) + a[i2] * size(i1, j) + b[j1] * size(i, j2) + b[j2] * size(i, j1);
        if (std::abs(t[i2] * r(i1, j) - t[i1] * r(i2, j)) > reach) return false;
      }
    return true;
  }

 private:
  static Eigen::Matrix3d axes_of(Points points) {
    Vec3d mean = Vec3d::Zero();
    for (const Vec3d& p : points) mean += p;
    mean /= static_cast<double>(points.size());
    Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
    for (const Vec3d& p : points) spread += (p - mean) * (p - mean).transpose();
    return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>{spread}.eigenvectors();
  }
  static OrientedVolume around(Points points, const Eigen::Matrix3d& axes) {
    Eigen::AlignedBox3d box;
    for (const Vec3d& p : points) box.extend(axes.transpose() * p);
    return make(axes * box.center(), box.sizes() / 2, axes);
  }
  static OrientedVolume make(const Vec3d& centre, const Vec3d& half, const Eigen::Matrix3d& axes) {
    OrientedVolume volume;
    const double margin = (centre.cwiseAbs().maxCoeff() + half.maxCoeff()) * 1e-6;
    Eigen::Map<Eigen::Vector3f>{volume.centre.data()} = centre.cast<float>();
    Eigen::Map<Eigen::Vector3f>{volume.half.data()} = (half + Vec3d::Constant(margin)).cast<float>();
    Eigen::Map<Eigen::Matrix3f>{volume.axes.data()} = axes.cast<float>();
    return volume;
  }
  [[nodiscard]] Vec3d middle() const { return {centre[0], centre[1], centre[2]}; }
  [[nodiscard]] Vec3d extent() const { return {half[0], half[1], half[2]}; }
  [[nodiscard]] Eigen::Matrix3d matrix() const { return Eigen::Map<const Eigen::Matrix3f>(axes.data()).cast<double>(); }
};

}  // namespace tactus::bench
