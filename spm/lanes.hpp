/// The arithmetic of the AB-tree's queries, for eight boxes or eight triangles at a time.
///
/// The kernels are compiled for several instruction sets. The program uses the best one of the processor. All give the
/// same bits. An empty lane consists of NaNs: every comparison with it is false. Do not query an AbTree before main,
/// because static initialization sets kBestKernels. Realtime.
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

/// Rows of eight boxes: low x, y, z, then high x, y, z.
inline constexpr int kBoxRows = 6;
/// Rows of eight triangles: x, y, z of corner a, then of b, then of c.
inline constexpr int kTriangleRows = 9;

struct Bounds {
  std::array<float, 3> low, high;  ///< low is above high if all lanes are empty
};

/// The points of eight triangles that are nearest to a given point.
struct Closest {
  alignas(64) std::array<Doubles, 3> point;
  alignas(64) Doubles squared_distance;
};

/// The eight faces of a node of level 1.
struct Faces {
  const Floats* corners;
  FaceId first;
  NodeIndex node;        ///< below 2^31
  std::uint32_t finest;  ///< bits of the faces in their finest version
};

/// Bounds, in float, that contain the volume that a sphere sweeps along a straight path.
struct SweepBounds {
  std::array<float, 3> middle;     ///< centre of a bounding sphere
  float squared_reach;             ///< squared radius of this bounding sphere
  std::array<float, 3> low, high;  ///< bounding box
  std::array<float, 3> direction;  ///< unit vector of the path
  float behind;                    ///< every triangle on the path has a point p with direction . p >= behind
};

/// A sphere whose centre moves from `from` by `motion`, in double.
struct Sweep {
  std::array<double, 3> from, motion;
  double radius, length;  ///< radius of the sphere, length of `motion`
  double extent;          ///< max absolute coordinate, to which rounding errors are proportional
};

struct Kernels {
  /// Squared distances of `p` to the boxes.
  void (*box_distances)(const Floats* boxes, const std::array<float, 3>& p, Floats& squared) noexcept;
  /// Bits of the boxes whose squared distance from `p` is at most `squared_radius`.
  unsigned (*boxes_within)(const Floats* boxes, const std::array<float, 3>& p, float squared_radius) noexcept;
  /// Bits of the boxes that intersect all `bounds` of a sweep.
  unsigned (*boxes_on_path)(const Floats* boxes, const SweepBounds& bounds) noexcept;
  void (*bounds_of_boxes)(const Floats* boxes, Bounds& bounds) noexcept;
  void (*bounds_of_triangles)(const Floats* corners, Bounds& bounds) noexcept;
  /// Bits of the triangles whose boxes have a squared distance from `p` of at most `squared_radius`.
  unsigned (*triangles_within)(const Floats* corners, const std::array<float, 3>& p, float squared_radius) noexcept;
  /// Bits of the triangles whose boxes intersect all `bounds` of a sweep.
  unsigned (*triangles_on_path)(const Floats* corners, const SweepBounds& bounds) noexcept;
  /// Bits of the triangles in `mask` for which spm::swept_sphere may find a contact at a time up to `limit`. Sets
  /// `earliest` to a lower bound of this time; the bound may differ between instruction sets. About 50 ns.
  unsigned (*sweep_candidates)(const Floats* corners, const Sweep& sweep, unsigned mask, double limit,
                               Doubles& earliest) noexcept;
  /// Computes spm::closest_point, up to rounding, for each lane in `mask`. The distance of other lanes may be NaN.
  /// About 20 ns.
  void (*closest_points)(const Floats* corners, const std::array<double, 3>& p, unsigned mask, Closest& out) noexcept;
  /// Writes a contact to `out` for each triangle in `mask` within `radius` of `p`, and returns their number. May
  /// write to all eight elements of `out`. About 20 ns.
  std::uint32_t (*touches)(const Faces& faces, const std::array<double, 3>& p, unsigned mask, double radius,
                           Contact* out) noexcept;
};

/// The kernels for `simd`, which the processor must have; for tests.
[[nodiscard]] const Kernels& kernels(Simd simd) noexcept;
/// The kernels for the best instruction set of the processor.
extern const Kernels kBestKernels;

}  // namespace tactus::spm::lanes
