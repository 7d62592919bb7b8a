/// The static objects with which movable bodies collide: meshes at their present resolution.
///
/// World frame, metres, unless the name says model. One thread at a time, the one that refines the meshes. Realtime.
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
  /// Scale, rotation row by row, translation; restores the same placement to the bit.
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
  /// All numbers are finite, the scale is above zero, and the rotation matrix is a rotation.
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
  std::uint32_t object = spm::kNone;  ///< copied to SurfaceHit
};

/// haptics::SurfaceDistance::closest over all `parts`. `caches`: candidate caches of sweeps near the point; null: none.
[[nodiscard]] bool closest_of(std::span<const ScenePart> parts, const Vec3d& point, double within,
                              haptics::SurfaceHit& hit, const spm::CandidateCaches* caches = nullptr) noexcept;

class Scene final : public haptics::SurfaceDistance {
 public:
  void clear() noexcept { count_ = 0; }
  /// At most spm::kMaxObjects.
  void add(const ScenePart& part) noexcept { parts_[count_++] = part; }
  [[nodiscard]] bool empty() const noexcept { return count_ == 0; }
  [[nodiscard]] bool closest(const Vec3d& point, double within, haptics::SurfaceHit& hit) const noexcept override {
    return closest_of({parts_.data(), count_}, point, within, hit);
  }

 private:
  std::array<ScenePart, spm::kMaxObjects> parts_;
  std::size_t count_ = 0;
};

/// Distance from a body's contact search points within which the mesh has to be the finest, m: the search distance plus
/// the motion until the mesh is refined.
inline constexpr double kAroundBody = 0.006;

/// Whether a sphere overlaps an object's bounds; `bounds` is in the model frame.
[[nodiscard]] inline bool near_bounds(const Placement& placement, const spm::CellBox& bounds, const Vec3d& centre,
                                      double radius) noexcept {
  const double reach = radius / placement.scale();
  return bounds.squared_distance(placement.to_model(centre)) <= reach * reach;
}

/// The body's centre in the world.
[[nodiscard]] inline Vec3d centre_of(const SharedBody& body, const Placement& placement) noexcept {
  return placement.translation() + placement.rotation() * body.centre;
}

/// Calls `visit(place)` with each point at which the box of `body`, whose model is at `placement`, searches for
/// contacts with an object of these bounds; in that object's model frame. Visits none when the object is too far away.
template <class Visit>
void for_each_place_beside(const SharedBody& body, const Placement& placement, const Placement& object,
                           const spm::CellBox& bounds, Visit&& visit) noexcept {
  const Vec3d& half = body.settings.half;
  const Vec3d centre = centre_of(body, placement);
  if (!near_bounds(object, bounds, centre, half.norm() + kAroundBody)) return;
  haptics::for_each_box_point(
      half, [&](const Vec3d& place) { visit(object.to_model(centre + placement.rotation() * place)); });
}

}  // namespace tactus::sharing
