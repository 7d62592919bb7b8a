/// Eight boxes or eight triangles at once: the arithmetic of the AB-tree's queries.
///
/// Compiled for several instruction sets, of which the program takes the best that the processor has; all give the same
/// bits. A lane that holds nothing is NaN throughout: it is never near, and no bound contains it. Not before main.
/// Realtime.
#pragma once

#include <array>
#include <cstdint>

#include "spm/contact.hpp"
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

/// Eight faces beside each other, as contacts tell of them.
struct Faces {
  const Floats* corners;
  std::uint32_t first;  ///< id of the first
  std::uint32_t node;   ///< below 2^31
  std::uint32_t last;   ///< bits of those in their finest version
};

/// A ball's straight way, bounded from outside.
struct Way {
  std::array<float, 3> middle;     ///< of a ball that holds all that is swept
  float squared_reach;             ///< of that ball
  std::array<float, 3> low, high;  ///< of a box that does
  std::array<float, 3> direction;  ///< of the way; what is touched has a point with direction . point >= behind
  float behind;
};

/// The same way exactly: of a ball whose centre goes from `from` by `motion`.
struct Sweep {
  std::array<double, 3> from, motion;
  double radius, length;  ///< of the ball, of `motion`
  double extent;          ///< greatest coordinate there may be: rounding is a share of it
};

struct Kernels {
  /// Squared distances of `p` to the boxes.
  void (*box_distances)(const Floats* boxes, const std::array<float, 3>& p, Floats& squared) noexcept;
  /// Bits of the boxes that come within the root of `squared_radius` of `p`.
  unsigned (*boxes_within)(const Floats* boxes, const std::array<float, 3>& p, float squared_radius) noexcept;
  /// Bits of the boxes that may be touched on the way.
  unsigned (*boxes_on)(const Floats* boxes, const Way& way) noexcept;
  void (*bounds_of_boxes)(const Floats* boxes, Bounds& bounds) noexcept;
  void (*bounds_of_triangles)(const Floats* corners, Bounds& bounds) noexcept;
  /// Bits of the triangles whose boxes come within the root of `squared_radius` of `p`.
  unsigned (*triangles_within)(const Floats* corners, const std::array<float, 3>& p, float squared_radius) noexcept;
  /// Bits of the triangles that may be touched on the way.
  unsigned (*triangles_on)(const Floats* corners, const Way& way) noexcept;
  /// Bits of the triangles of `wanted` that spm::swept_sphere may say are touched at a time of at most `limit`;
  /// `earliest` then is not later than what it says; how much earlier differs between instruction sets. About 50 ns.
  unsigned (*touched_by)(const Floats* corners, const Sweep& sweep, unsigned wanted, double limit,
                         Doubles& earliest) noexcept;
  /// As spm::closest_point for each lane of `wanted`, up to rounding; others may be left out, their distances then NaN.
  /// About 20 ns.
  void (*closest_points)(const Floats* corners, const std::array<double, 3>& p, unsigned wanted, Closest& out) noexcept;
  /// Writes the contacts with those of `wanted` that are within `radius` of `p` to `out`, one after the other; eight
  /// places are written to in any case. Returns how many. About 20 ns.
  std::uint32_t (*touches)(const Faces& faces, const std::array<double, 3>& p, unsigned wanted, double radius,
                           Contact* out) noexcept;
};

/// Those compiled for `simd`, which the processor must have; for tests.
[[nodiscard]] const Kernels& kernels(Simd simd) noexcept;
/// Those for the best that the processor has.
extern const Kernels kBest;

}  // namespace tactus::spm::lanes
