/// Eight boxes or eight triangles at a time: the arithmetic of the AB-tree's queries.
///
/// Compiled for several instruction sets; the program uses the best one that the processor has. All give the same bits.
/// An empty lane is NaN throughout: it is near nothing and inside no bound. Not usable before main. Realtime.
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

/// The eight faces of a tree node.
struct Faces {
  const Floats* corners;
  FaceId first;
  NodeIndex node;      ///< below 2^31
  std::uint32_t last;  ///< bits of the faces in their finest version
};

/// Outer bounds of a sphere's straight path, in float.
struct Way {
  std::array<float, 3> middle;     ///< of a sphere around the swept volume
  float squared_reach;             ///< of that sphere
  std::array<float, 3> low, high;  ///< of a box around the swept volume
  std::array<float, 3> direction;  ///< of the path; a touched triangle has a point with direction . point >= behind
  float behind;
};

/// The same path in double: the centre moves from `from` by `motion`.
struct Sweep {
  std::array<double, 3> from, motion;
  double radius, length;  ///< of the sphere; of `motion`
  double extent;          ///< maximum coordinate; rounding errors are proportional to it
};

struct Kernels {
  /// Squared distances of `p` to the boxes.
  void (*box_distances)(const Floats* boxes, const std::array<float, 3>& p, Floats& squared) noexcept;
  /// Bits of the boxes whose squared distance from `p` is at most `squared_radius`.
  unsigned (*boxes_within)(const Floats* boxes, const std::array<float, 3>& p, float squared_radius) noexcept;
  /// Bits of the boxes that the sphere may touch on its path.
  unsigned (*boxes_on)(const Floats* boxes, const Way& way) noexcept;
  void (*bounds_of_boxes)(const Floats* boxes, Bounds& bounds) noexcept;
  void (*bounds_of_triangles)(const Floats* corners, Bounds& bounds) noexcept;
  /// Bits of the triangles whose boxes have a squared distance from `p` of at most `squared_radius`.
  unsigned (*triangles_within)(const Floats* corners, const std::array<float, 3>& p, float squared_radius) noexcept;
  /// Bits of the triangles that the sphere may touch on its path.
  unsigned (*triangles_on)(const Floats* corners, const Way& way) noexcept;
  /// Bits of the triangles of `wanted` for which spm::swept_sphere may return a time up to `limit`. `earliest` is a
  /// lower bound of that time, which differs between instruction sets. About 50 ns.
  unsigned (*touched_by)(const Floats* corners, const Sweep& sweep, unsigned wanted, double limit,
                         Doubles& earliest) noexcept;
  /// spm::closest_point for each lane of `wanted`, up to rounding; the distance of other lanes may be NaN. About 20 ns.
  void (*closest_points)(const Floats* corners, const std::array<double, 3>& p, unsigned wanted, Closest& out) noexcept;
  /// Writes a contact to `out` for each triangle of `wanted` within `radius` of `p` and returns how many. It may write
  /// to all eight elements of `out`. About 20 ns.
  std::uint32_t (*touches)(const Faces& faces, const std::array<double, 3>& p, unsigned wanted, double radius,
                           Contact* out) noexcept;
};

/// The kernels for `simd`, which the processor must have; for tests.
[[nodiscard]] const Kernels& kernels(Simd simd) noexcept;
/// The kernels for the best instruction set of the processor.
extern const Kernels kBest;

}  // namespace tactus::spm::lanes
