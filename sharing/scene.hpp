/// Contact queries between movable bodies and static objects, on the active meshes of the static objects.
///
/// World frame, metres, unless the name says model. Only the thread that refines the meshes may call. Realtime.
#pragma once

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <span>

#include "haptics/surface.hpp"
#include "session/messages.hpp"
#include "sharing/body.hpp"
#include "spm/ab_tree.hpp"
#include "spm/region_grid.hpp"

namespace tactus::sharing {

using haptics::Vec3d;

/// Placement of a model: world = rotation * (scale * model) + translation. World in metres, model in file units.
class Placement {
 public:
  Placement() = default;
  Placement(const session::Pose& pose, double scale)
      : scale_{scale},
        rotation_{Eigen::Quaterniond{pose.orientation[3], pose.orientation[0], pose.orientation[1], pose.orientation[2]}
                      .normalized()
                      .toRotationMatrix()},
        translation_{pose.position[0], pose.position[1], pose.position[2]} {}

  [[nodiscard]] Vec3d to_model(const Vec3d& world) const noexcept {
    return rotation_.transpose() * (world - translation_) / scale_;
  }
  [[nodiscard]] Vec3d to_world(const Vec3d& model) const noexcept {
    return rotation_ * (scale_ * model) + translation_;
  }
  [[nodiscard]] Vec3d direction_to_world(const Vec3d& model) const noexcept { return rotation_ * model; }
  [[nodiscard]] Vec3d direction_to_model(const Vec3d& world) const noexcept { return rotation_.transpose() * world; }
  [[nodiscard]] double scale() const noexcept { return scale_; }
  [[nodiscard]] const Eigen::Matrix3d& rotation() const noexcept { return rotation_; }
  [[nodiscard]] const Vec3d& translation() const noexcept { return translation_; }
  /// Scale, rotation matrix row by row, and translation. The constructor with Numbers restores exactly the same
  /// placement.
  using Numbers = std::array<double, 13>;
  [[nodiscard]] Numbers numbers() const noexcept {
    Numbers all{scale_};
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) all[1 + 3 * row + column] = rotation_(row, column);
      all[10 + row] = translation_[row];
    }
    return all;
  }
  explicit Placement(const Numbers& all) noexcept : scale_{all[0]} {
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) rotation_(row, column) = all[1 + 3 * row + column];
      translation_[row] = all[10 + row];
    }
  }
  /// Whether all numbers are finite, the scale is positive, and the matrix is a rotation.
  [[nodiscard]] bool valid() const noexcept {
    constexpr double kTolerance = 1e-6;
    return std::isfinite(scale_) && scale_ > 0 && translation_.allFinite() && rotation_.isUnitary(kTolerance) &&
           rotation_.determinant() > 0;
  }

 private:
  double scale_ = 1;
  Eigen::Matrix3d rotation_ = Eigen::Matrix3d::Identity();
  Vec3d translation_ = Vec3d::Zero();
};

/// A mesh and its placement; both must outlive the scene.
struct ScenePart {
  const spm::AbTree* tree = nullptr;
  const Placement* placement = nullptr;
  std::uint32_t object = spm::kNone;  ///< written to SurfaceHit::object
};

/// Finds the closest point of all `parts`, as haptics::SurfaceDistance::closest does. `caches`: candidate caches of
/// earlier sweeps near the point, or null.
[[nodiscard]] bool closest_of(std::span<const ScenePart> parts, const Vec3d& point, double max_distance,
                              haptics::SurfaceHit& hit, const spm::CandidateCaches* caches = nullptr) noexcept;

/// A list of static objects.
class Scene final : public haptics::SurfaceDistance {
 public:
  void clear() noexcept { count_ = 0; }
  /// Adds an object; at most spm::kMaxObjects between two calls of `clear`.
  void add(const ScenePart& part) noexcept { parts_[count_++] = part; }
  [[nodiscard]] bool empty() const noexcept { return count_ == 0; }
  [[nodiscard]] bool closest(const Vec3d& point, double max_distance,
                             haptics::SurfaceHit& hit) const noexcept override {
    return closest_of({parts_.data(), count_}, point, max_distance, hit);
  }

 private:
  std::array<ScenePart, spm::kMaxObjects> parts_;
  std::size_t count_ = 0;
};

/// Within this distance of the points from which a body searches for contacts, the mesh must be at full resolution, m:
/// the max gap of a contact (5 mm), plus the distance that the body moves until the mesh is refined.
inline constexpr double kBodySearchDistance = 0.006;

/// Whether a sphere overlaps an object's bounds; `bounds` is in the model frame.
[[nodiscard]] inline bool overlaps_bounds(const Placement& placement, const spm::CellBox& bounds, const Vec3d& centre,
                                          double radius) noexcept {
  const double reach = radius / placement.scale();
  return bounds.squared_distance(placement.to_model(centre)) <= reach * reach;
}

/// The centre of mass of a body whose model is at `placement`, world frame.
[[nodiscard]] inline Vec3d centre_of(const SharedBody& body, const Placement& placement) noexcept {
  return placement.translation() + placement.rotation() * body.centre;
}

/// Calls `visit(point)` for each point from which `body`, whose model is at `placement`, searches for contacts with an
/// object. `bounds` and the points are in the object's model frame. Visits no point if the object is too far away.
template <class Visit>
void for_each_search_point(const SharedBody& body, const Placement& placement, const Placement& object,
                           const spm::CellBox& bounds, Visit&& visit) noexcept {
  const Vec3d& half = body.settings.half;
  const Vec3d centre = centre_of(body, placement);
  if (!overlaps_bounds(object, bounds, centre, half.norm() + kBodySearchDistance)) return;
  haptics::for_each_box_point(
      half, [&](const Vec3d& point) { visit(object.to_model(centre + placement.rotation() * point)); });
}

}  // namespace tactus::sharing
