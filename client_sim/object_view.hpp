/// The objects of a session as a simulated user sees them: boxes with surface points, because the user has no mesh.
///
/// World frame, SI. Not realtime.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "client_sim/scenario.hpp"
#include "session/messages.hpp"

namespace tactus::client_sim {

/// An object as its catalogue entry describes it. The box is the model's bounds.
struct ObjectView {
  std::uint64_t id = 0;
  Vec3d centre = Vec3d::Zero();                            ///< of the box; world, m
  Vec3d half_size = Vec3d::Zero();                         ///< half edges of the box along the object's axes, m
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< from the object's axes to world
  bool is_movable = false;
  struct SurfacePoint {
    Vec3d position, normal;  ///< world, m; the normal is zero where it is unknown
  };
  std::vector<SurfacePoint> surface;  ///< empty: the whole box counts as solid
  double spacing = 0;                 ///< m; max distance from a point of the real surface to the nearest in `surface`
};
[[nodiscard]] inline Vec3d vector_of(const std::array<double, 3>& a) { return {a[0], a[1], a[2]}; }
[[nodiscard]] ObjectView view_of(const session::CatalogueEntry& entry);

/// By object name.
using Objects = std::map<std::string, ObjectView>;

/// Returns the object that a scenario names, or null if there is none. "#n" is the n-th static object in the order of
/// names; n is taken modulo the number of static objects.
[[nodiscard]] const ObjectView* find_object(const Objects& objects, const std::string& reference);

/// Returns the point of `view.surface` that is nearest to `from`, or the centre of the box if there are no points.
[[nodiscard]] Vec3d nearest_surface_point(const ObjectView& view, const Vec3d& from);

/// Returns the max distance of a point of the box from the centre, measured along a unit vector, m.
[[nodiscard]] double half_extent_along(const ObjectView& view, const Vec3d& direction);

/// Returns the distance from a point inside the box to the boundary of the box along a unit vector, m.
[[nodiscard]] double exit_distance(const ObjectView& view, const Vec3d& from, const Vec3d& direction);

/// Returns a unit vector perpendicular to `axis`; equal arguments give equal results.
[[nodiscard]] Vec3d perpendicular_to(const Vec3d& axis);

}  // namespace tactus::client_sim
