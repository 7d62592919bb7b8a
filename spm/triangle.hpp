/// Computes the distance of a point from a triangle, and the contact of a moving sphere with a triangle, in double.
///
/// All arguments of a call have the same frame and unit. A triangle may be degenerate: a segment or a point. Both sides
/// of a triangle collide. Realtime.
#pragma once

#include <algorithm>
#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm {

/// The part of a triangle on which a point lies.
enum class Feature : std::uint8_t { kFace, kEdgeAb, kEdgeBc, kEdgeCa, kVertexA, kVertexB, kVertexC };

struct ClosestPoint {
  Vec3d point;              ///< on the triangle, up to rounding
  double squared_distance;  ///< from the query point
  Feature feature;
};

/// The first contact of a moving sphere.
struct SweepHit {
  double time;   ///< share of the motion before the contact, in [0, 1] up to rounding
  Vec3d point;   ///< contact point on the triangle
  Vec3d normal;  ///< unit vector from `point` to the sphere's centre at the contact
  Feature feature;
};

namespace detail {

/// Replaces `best` if segment ab has a point nearer to p.
inline void nearer_on_segment(const Vec3d& p, const Vec3d& a, const Vec3d& b, Feature on_edge, Feature at_a,
                              Feature at_b, ClosestPoint& best) noexcept {
  const Vec3d ab = b - a;
  const double along = ab.dot(p - a);
  const double length2 = ab.squaredNorm();
  Vec3d point;
  Feature feature;
  if (!(along > 0)) {
    point = a;
    feature = at_a;
  } else if (along >= length2) {
    point = b;
    feature = at_b;
  } else {
    point = a + ab * (along / length2);
    feature = on_edge;
  }
  const double squared_distance = (p - point).squaredNorm();
  if (squared_distance < best.squared_distance) best = {point, squared_distance, feature};
}

}  // namespace detail

/// Returns the point of triangle abc that is closest to p. The distance is exact up to rounding, also for a degenerate
/// triangle or a needle. Realtime, about 20 ns.
[[nodiscard]] inline ClosestPoint closest_point(const Vec3d& p, const Vec3d& a, const Vec3d& b,
                                                const Vec3d& c) noexcept {
  const Vec3d ab = b - a;
  const Vec3d ac = c - a;
  const Vec3d ap = p - a;
  ClosestPoint best{a, ap.squaredNorm(), Feature::kVertexA};
  // ab and h are orthogonal axes in the plane. For a needle, a cross product would lose precision.
  const double ab2 = ab.squaredNorm();
  const double slant = ab2 > 0 ? ab.dot(ac) / ab2 : 0;
  const Vec3d h = ac - ab * slant;
  const double h2 = h.squaredNorm();
  const double longest2 = std::max({ab2, ac.squaredNorm(), (c - b).squaredNorm()});
  // The nearest point can only be on an edge if p is beyond this edge. If rounding errors could decide, all edges are
  // tried.
  bool on_ab = true, on_bc = true, on_ca = true;
  // For flatter triangles the height is rounding noise, so only the edges are tried.
  constexpr double kFlat = 1e-28;
  if (ab2 * h2 > kFlat * longest2 * longest2) {
    const double s = ab.dot(ap) / ab2;
    const double w = h.dot(ap - ab * s) / h2;  // barycentric coordinate of c
    const double v = s - slant * w;            // barycentric coordinate of b
    const double u = 1 - v - w;                // barycentric coordinate of a
    constexpr double kInside = 1e-6;
    constexpr double kNeedle = 1e-6;
    if (ab2 * h2 > kNeedle * longest2 * longest2) {
      on_ab = w <= kInside;
      on_bc = u <= kInside;
      on_ca = v <= kInside;
    }
    if (v >= 0 && w >= 0 && u >= 0) {
      const Vec3d point = a + ab * s + h * w;
      best = {point, (p - point).squaredNorm(), Feature::kFace};
    }
  }
  using detail::nearer_on_segment;
  if (on_ab) nearer_on_segment(p, a, b, Feature::kEdgeAb, Feature::kVertexA, Feature::kVertexB, best);
  if (on_bc) nearer_on_segment(p, b, c, Feature::kEdgeBc, Feature::kVertexB, Feature::kVertexC, best);
  if (on_ca) nearer_on_segment(p, c, a, Feature::kEdgeCa, Feature::kVertexC, Feature::kVertexA, best);
  return best;
}

/// Finds the first contact of triangle abc with a sphere whose centre moves straight from `from` to `to`. False if
/// there is none; `hit` is then unchanged. The sphere may be a point (radius 0). A miss within rounding may count as a
/// contact. Realtime, computes at most 33 closest points.
///
/// The triangle is convex, so the distance of the centre is a convex function of time: once it grows, it never shrinks
/// again. This decides the cases at time 0:
/// - If the sphere already touches the triangle (distance <= radius), it has a contact at time 0 if the distance
///   shrinks, that is if `(to - from) . normal < 0`. Otherwise it has none, because it slides along the triangle or
///   leaves it.
/// - If the centre is on the triangle, `normal` is the normal of (a, b, c). If the triangle is then degenerate, there
///   is no contact.
[[nodiscard]] bool swept_sphere(const Vec3d& from, const Vec3d& to, double radius, const Vec3d& a, const Vec3d& b,
                                const Vec3d& c, SweepHit& hit) noexcept;

}  // namespace tactus::spm
