/// Exact signs of determinants of points, whatever the rounding.
///
/// A double-precision value decides where its error bound allows; otherwise the determinant is summed up exactly, as a
/// non-overlapping sum of doubles. Right unless a product of three differences over- or underflows. Any frame and unit.
/// Realtime: about 10 ns, a few microseconds where points are as good as coplanar.
/// Source: Shewchuk, Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates, 1997.
#pragma once

#include "spm/model.hpp"

namespace tactus::spm {

/// Sign of (b - a) x (c - a) . (d - a): 1 when abc runs counter-clockwise seen from d, 0 when all four are coplanar.
[[nodiscard]] int orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) noexcept;

/// Sign of the area of abc in the plane of coordinates `x` and `y` (0, 1 or 2 each): 1 when counter-clockwise, 0 when
/// the three are collinear there.
[[nodiscard]] int orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, int x, int y) noexcept;

}  // namespace tactus::spm
