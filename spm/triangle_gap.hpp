/// How far apart two triangles are, and where: eight pairs side by side.
///
/// In float, so coordinates belong to an origin nearby: of coordinates up to L the distance is right to some 3e-7 L.
/// Any unit. Triangles may be degenerate: a segment or a point is then what is near. Of parallel parts any nearest
/// point may be told. Realtime.
#pragma once

#include <cstdint>

#include "spm/simd.hpp"

namespace tactus::spm {

/// [corner][axis][lane]; lanes that are not asked for must be finite.
struct alignas(64) TriangleLanes {
  static constexpr int kWidth = 8;
  float corner[3][3][kWidth];
};

struct alignas(64) TriangleGaps {
  float distance[TriangleLanes::kWidth];
  float on_object[3][TriangleLanes::kWidth], on_probe[3][TriangleLanes::kWidth];  ///< nearest points, by axis
  /// By lane: each has corners on both sides of the other's plane, so that the two may meet, of which `distance`, that
  /// of their edges and corners, knows nothing. No bit: they do not meet, or as good as touch.
  unsigned may_meet;
};

/// The same bits for every `simd`.
void gaps(const TriangleLanes& object, const TriangleLanes& probe, TriangleGaps& out, Simd simd) noexcept;

}  // namespace tactus::spm
