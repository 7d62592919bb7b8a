/// Distance and nearest points of two triangles: eight pairs at a time.
///
/// In float, so the origin should be near: for coordinates up to L the error of the distance is some 3e-7 L. Any unit.
/// Triangles may be degenerate: a segment or a point. Of parallel parts, any nearest point may be returned. Realtime.
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
  /// A bit for each lane: each triangle has corners on both sides of the other's plane, so they may intersect.
  /// `distance`, which is between edges and corners, does not show that. No bit: they do not intersect, except within
  /// rounding.
  unsigned may_meet;
};

/// The same bits for every `simd`.
void gaps(const TriangleLanes& object, const TriangleLanes& probe, TriangleGaps& out, Simd simd) noexcept;

}  // namespace tactus::spm
