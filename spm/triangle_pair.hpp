/// Exact intersection test of two triangles, with point, normal and depth.
///
/// A triangle of the object, abc, against a triangle of a probe, pqr, in one frame and any unit. Both are closed: a
/// common point is an intersection, also at a corner, along an edge or in a common plane. The decision is exact for the
/// given coordinates (see orientation.hpp). A triangle with collinear corners intersects nothing, because its
/// neighbours cover the same points. Realtime: about 40 ns; microseconds if points of one triangle are almost in the
/// plane of the other.
#pragma once

#include <array>
#include <cstdint>

#include "spm/model.hpp"
#include "spm/simd.hpp"

namespace tactus::spm {

using Triangle3d = std::array<Vec3d, 3>;

struct PairContact {
  /// Middle of the intersection segment: mean of the points at which an edge of one triangle pierces the other. In a
  /// common plane: mean of the corners inside the other triangle and of the edge crossings.
  Vec3d point;
  /// Unit normal of the object's triangle, towards the side from which its corners are counter-clockwise.
  Vec3d normal;
  /// Distance by which the probe's triangle must move along `normal` until the two no longer intersect. 0 if they only
  /// touch from above.
  double depth;
};

/// True if they intersect; then sets `contact`. The decision is exact; point and depth are exact up to rounding.
[[nodiscard]] bool meet(const Triangle3d& object, const Triangle3d& probe, PairContact& contact) noexcept;

/// Eight pairs side by side: [corner][axis][lane].
struct alignas(64) TrianglePairs {
  static constexpr int kWidth = 8;
  double object[3][3][kWidth], probe[3][3][kWidth];
};

/// The contacts of eight pairs, by lane; undefined for pairs that do not intersect.
struct alignas(64) PairContacts {
  double point[3][TrianglePairs::kWidth], normal[3][TrianglePairs::kWidth], depth[TrianglePairs::kWidth];
};

/// One bit for each of the first `count` pairs that intersects. All `simd` give the bits of `meet` for single pairs.
[[nodiscard]] unsigned meet(const TrianglePairs& pairs, unsigned count, PairContacts& contacts, Simd simd) noexcept;

}  // namespace tactus::spm
