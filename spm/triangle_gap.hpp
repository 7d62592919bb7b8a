/// Computes distance and nearest points of two triangles, for eight pairs at a time.
///
/// Uses float: if the absolute coordinates are up to L, the error of the distance is some 3e-7 L, so the origin should
/// be near the triangles. Any unit. Triangles may be degenerate: a segment or a point. If several pairs of points are
/// nearest, returns any of them. Realtime.
#pragma once

#include <cstdint>

#include "spm/simd.hpp"

namespace tactus::spm {

/// [corner][axis][lane]; unused lanes must be finite.
struct alignas(64) TriangleLanes {
  static constexpr int kWidth = 8;
  float corner[3][3][kWidth];
};

struct alignas(64) TriangleGaps {
  float distance[TriangleLanes::kWidth];
  float on_object[3][TriangleLanes::kWidth], on_probe[3][TriangleLanes::kWidth];  ///< nearest points, by axis
  /// One bit for each lane. It is 1 if each triangle has corners on both sides of the other's plane, so that the
  /// triangles may intersect; if it is 0, they do not intersect, except within rounding. `distance` does not show an
  /// intersection, because it is computed between edges and corners.
  unsigned may_intersect;
};

/// Computes the gaps of all lanes. Every `simd` gives the same bits.
void gaps(const TriangleLanes& object, const TriangleLanes& probe, TriangleGaps& out, Simd simd) noexcept;

}  // namespace tactus::spm
