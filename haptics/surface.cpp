#include "haptics/surface.hpp"

#include <Eigen/Geometry>
#include <cmath>

namespace tactus::haptics {

using spm::Feature;

void FirstTouch::add_triangle(const Vec3d& a, const Vec3d& b, const Vec3d& c, std::uint32_t object,
                              std::uint32_t face) noexcept {
  spm::SweepHit hit;
  if (!spm::swept_sphere(from_, to_, radius_, a, b, c, hit)) return;
  if (found_ && (hit.time > best_.time || (hit.time == best_.time && !comes_before(object, face)))) return;
  found_ = true;
  best_.time = hit.time;
  best_.point = hit.point;
  best_.normal = hit.normal;
  best_.object = object;
  best_.face = face;
}

bool FirstTouch::result(SurfaceHit& hit) const noexcept {
  if (found_) hit = best_;
  return found_;
}

namespace {

/// Angle of triangle abc at its corner a, rad; 0 when degenerate.
double angle_at(const Vec3d& a, const Vec3d& b, const Vec3d& c) noexcept {
  const Vec3d ab = b - a;
  const Vec3d ac = c - a;
  return std::atan2(ab.cross(ac).norm(), ab.dot(ac));
}

/// Weight of the normal of triangle abc: its angle at the vertex that is closest, or 1 on an edge or face.
double weight_of(Feature feature, const Vec3d& a, const Vec3d& b, const Vec3d& c) noexcept {
  switch (feature) {
    case Feature::kVertexA:
      return angle_at(a, b, c);
    case Feature::kVertexB:
      return angle_at(b, c, a);
    case Feature::kVertexC:
      return angle_at(c, a, b);
    default:
      return 1;
  }
}

bool is_edge(Feature feature) noexcept {
  return feature == Feature::kEdgeAb || feature == Feature::kEdgeBc || feature == Feature::kEdgeCa;
}

}  // namespace

void ClosestSide::add_triangle(const Vec3d& a, const Vec3d& b, const Vec3d& c, std::uint32_t object,
                               std::uint32_t face) noexcept {
  const spm::ClosestPoint closest = spm::closest_point(query_, a, b, c);
  const double distance = std::sqrt(closest.squared_distance);
  // Distance below which two points count as the same. The closest point on an edge is computed for each of its faces,
  // and the rounding errors of the results are far smaller than this distance.
  constexpr double kSamePoint = 1e-10;
  const bool shared = faces_ > 0 && (closest.point - point_).squaredNorm() <
                                        kSamePoint * kSamePoint * std::max(1.0, point_.squaredNorm());
  if (!shared) {
    if (!(distance < reach_)) return;
    point_ = closest.point;
    normal_.setZero();
    faces_ = 0;
    on_edge_ = is_edge(closest.feature);
    object_ = object;
    face_ = face;
  }
  reach_ = std::min(reach_, distance);
  normal_ += weight_of(closest.feature, a, b, c) * (b - a).cross(c - a).stableNormalized();
  ++faces_;
}

bool ClosestSide::result(SurfaceHit& hit) const noexcept {
  if (faces_ == 0) return false;
  const Vec3d offset = query_ - point_;
  const double distance = offset.norm();
  const double length = normal_.norm();
  constexpr double kCancelled = 1e-9;
  hit.is_side_known = length > kCancelled && !(on_edge_ && faces_ == 1);
  hit.point = point_;
  hit.normal =
      length > kCancelled ? Vec3d(normal_ / length) : (distance > 0 ? Vec3d(offset / distance) : Vec3d::UnitZ());
  hit.distance = hit.is_side_known && offset.dot(hit.normal) < 0 ? -distance : distance;
  hit.time = 1;
  hit.object = object_;
  hit.face = face_;
  return true;
}

}  // namespace tactus::haptics
