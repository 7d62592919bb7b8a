/// Tests exactly whether a triangle of an object intersects a triangle of a probe, and computes point, normal and
/// depth.
///
/// Both triangles are in the same frame and unit. They are closed: a common point is an intersection, also at a corner,
/// along an edge or in a common plane. The decision is exact for the given coordinates (see orientation.hpp). A
/// triangle with collinear corners intersects nothing, because its neighbours cover the same points. Realtime: about 40
/// ns, or microseconds if corners of one triangle are almost in the plane of the other.
#pragma once

#include <array>
#include <cstdint>

#include "spm/model.hpp"
#include "spm/simd.hpp"

namespace tactus::spm {

using Triangle3d = std::array<Vec3d, 3>;

struct PairContact {
  /// Middle of the intersection segment: the mean of the points at which an edge of one triangle pierces the other. If
  /// the triangles have a common plane, the mean of the corners inside the other triangle and of the edge crossings.
  Vec3d point;
  /// Unit normal of the object's triangle, towards the side from which its corners are counter-clockwise.
  Vec3d normal;
  /// Distance by which the probe's triangle must move along `normal` until the triangles no longer intersect. 0 if the
  /// probe's triangle only touches the other from above.
  double depth;
};

/// True if the triangles intersect; then sets `contact`. The decision is exact. Point and depth are exact up to
/// rounding.
[[nodiscard]] bool intersect(const Triangle3d& object, const Triangle3d& probe, PairContact& contact) noexcept;

/// Eight pairs of triangles: [corner][axis][lane].
struct alignas(64) TrianglePairs {
  static constexpr int kWidth = 8;
  double object[3][3][kWidth], probe[3][3][kWidth];
};

/// The contacts of eight pairs, by lane; undefined for pairs that do not intersect.
struct alignas(64) PairContacts {
  double point[3][TrianglePairs::kWidth], normal[3][TrianglePairs::kWidth], depth[TrianglePairs::kWidth];
};

/// Returns the bits of the pairs that intersect among the first `count`. Every `simd` gives the same contacts, to the
/// bit, as `intersect` for single pairs.
[[nodiscard]] unsigned intersect(const TrianglePairs& pairs, unsigned count, PairContacts& contacts,
                                 Simd simd) noexcept;

}  // namespace tactus::spm
