/// Eight boxes or eight triangles at once: the arithmetic of the AB-tree's queries.
///
/// Compiled for several instruction sets, of which the program takes the best that the processor has; all give the same
/// bits. A lane that holds nothing is NaN throughout: it is never near, and no bound contains it. Not before main.
/// Realtime.
#pragma once

#include <array>

#include "spm/simd.hpp"

namespace tactus::spm::lanes {

inline constexpr int kLanes = 8;
inline constexpr unsigned kAllLanes = (1u << kLanes) - 1;
using Floats = std::array<float, kLanes>;
using Doubles = std::array<double, kLanes>;

/// Boxes by axis: low x, y, z, then high x, y, z.
inline constexpr int kBoxRows = 6;
/// Triangles by corner, then axis: a x, a y, a z, b x, ...
inline constexpr int kTriangleRows = 9;

struct Bounds {
  std::array<float, 3> low, high;  ///< inverted when all lanes are empty
};

/// The nearest points of eight triangles.
struct Closest {
  alignas(64) std::array<Doubles, 3> point;
  alignas(64) Doubles squared_distance;
};

/// Where a ball touches eight triangles.
struct Touches {
  alignas(64) std::array<Doubles, 3> point, normal;  ///< nearest to the centre; unit, from there to the centre
  alignas(64) Doubles depth;                         ///< radius less distance; where that is all of it, normal is NaN
};

struct Kernels {
  /// Squared distances of `p` to the boxes.
  void (*box_distances)(const Floats* boxes, const std::array<float, 3>& p, Floats& squared) noexcept;
  /// Bits of the boxes that come within the root of `squared_radius` of `p`.
  unsigned (*boxes_within)(const Floats* boxes, const std::array<float, 3>& p, float squared_radius) noexcept;
  /// Bits of the boxes that meet the box from `low` to `high`.
  unsigned (*boxes_meeting)(const Floats* boxes, const std::array<float, 3>& low,
                            const std::array<float, 3>& high) noexcept;
  void (*bounds_of_boxes)(const Floats* boxes, Bounds& bounds) noexcept;
  void (*bounds_of_triangles)(const Floats* corners, Bounds& bounds) noexcept;
  /// Bits of the triangles whose boxes come within the root of `squared_radius` of `p`.
  unsigned (*triangles_within)(const Floats* corners, const std::array<float, 3>& p, float squared_radius) noexcept;
  /// As spm::closest_point for each lane of `wanted`, up to rounding; others may be left out, their distances then NaN.
  /// About 50 ns.
  void (*closest_points)(const Floats* corners, const std::array<double, 3>& p, unsigned wanted, Closest& out) noexcept;
  /// Bits of the triangles of `wanted` within `radius` of `p`; the lanes of others mean nothing.
  unsigned (*touches)(const Floats* corners, const std::array<double, 3>& p, unsigned wanted, double radius,
                      Touches& out) noexcept;
};

/// Those compiled for `simd`, which the processor must have; for tests.
[[nodiscard]] const Kernels& kernels(Simd simd) noexcept;
/// Those for the best that the processor has.
extern const Kernels kBest;

}  // namespace tactus::spm::lanes
