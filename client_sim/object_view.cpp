#include "client_sim/object_view.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

namespace tactus::client_sim {

ObjectView view_of(const session::CatalogueEntry& entry) {
  const Eigen::Quaterniond rotation{entry.pose.orientation[3], entry.pose.orientation[0], entry.pose.orientation[1],
                                    entry.pose.orientation[2]};
  const auto& low = entry.summary.bounds_min;
  const auto& high = entry.summary.bounds_max;
  Vec3d centre;
  ObjectView view;
  for (int axis = 0; axis < 3; ++axis) {
    centre[axis] = 0.5 * (static_cast<double>(low[axis]) + static_cast<double>(high[axis]));
    view.half_size[axis] = 0.5 * entry.scale * (static_cast<double>(high[axis]) - static_cast<double>(low[axis]));
  }
  view.id = entry.object_id;
  view.is_movable = entry.body.mass > 0;
  view.rotation = rotation.normalized().toRotationMatrix();
  view.centre = view.rotation * (entry.scale * centre) + vector_of(entry.pose.position);
  const auto vector = [](const std::array<float, 3>& a) { return Vec3d{double{a[0]}, double{a[1]}, double{a[2]}}; };
  for (const spm::SurfacePoint& point : entry.surface.points)
    view.surface.push_back({view.rotation * (entry.scale * vector(point.position)) + vector_of(entry.pose.position),
                            view.rotation * vector(point.normal)});
  view.spacing = entry.scale * entry.surface.spacing;
  return view;
}

const ObjectView* find_object(const Objects& objects, const std::string& reference) {
  if (const std::uint32_t ordinal = ordinal_of(reference); ordinal > 0) {
    std::vector<const ObjectView*> fixed;
    for (const auto& [name, view] : objects)
      if (!view.is_movable) fixed.push_back(&view);
    return fixed.empty() ? nullptr : fixed[(ordinal - 1) % fixed.size()];
  }
  const auto found = objects.find(reference);
  return found == objects.end() ? nullptr : &found->second;
}

Vec3d nearest_surface_point(const ObjectView& view, const Vec3d& from) {
  const auto nearer = [&](const ObjectView::SurfacePoint& a, const ObjectView::SurfacePoint& b) {
    return (a.position - from).squaredNorm() < (b.position - from).squaredNorm();
  };
  const auto nearest = std::min_element(view.surface.begin(), view.surface.end(), nearer);
  return nearest == view.surface.end() ? view.centre : nearest->position;
}

double half_extent_along(const ObjectView& view, const Vec3d& direction) {
  return (view.rotation.transpose() * direction).cwiseAbs().dot(view.half_size);
}

double exit_distance(const ObjectView& view, const Vec3d& from, const Vec3d& direction) {
  const Vec3d p = view.rotation.transpose() * (from - view.centre);
  const Vec3d d = view.rotation.transpose() * direction;
  double nearest = 2 * view.half_size.norm();
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(d[axis]) > 1e-9) {
      nearest = std::min(nearest, (std::copysign(view.half_size[axis], d[axis]) - p[axis]) / d[axis]);
    }
  }
  return std::max(nearest, 0.0);
}

Vec3d perpendicular_to(const Vec3d& axis) {
  const Vec3d helper = std::abs(axis.x()) < 0.7 ? Vec3d::UnitX() : Vec3d::UnitY();
  return (helper - axis * axis.dot(helper)).normalized();
}

}  // namespace tactus::client_sim
