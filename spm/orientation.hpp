/// Exact signs of determinants of points.
///
/// The double-precision value decides if its error bound allows it; otherwise the determinant is summed exactly, as a
/// non-overlapping sum of doubles. Exact unless a product of three differences overflows or underflows. Any frame and
/// unit. Realtime: about 10 ns, a few microseconds if points are almost coplanar.
/// Source: Shewchuk, Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates, 1997.
#pragma once

#include "spm/model.hpp"

namespace tactus::spm {

/// Sign of (b - a) x (c - a) . (d - a): 1 if abc is counter-clockwise seen from d, 0 if all four are coplanar.
[[nodiscard]] int orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) noexcept;

/// Sign of the area of abc in the plane of coordinates `x` and `y` (0, 1 or 2 each): 1 if counter-clockwise, 0 if
/// the projected points are collinear.
[[nodiscard]] int orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, int x, int y) noexcept;

}  // namespace tactus::spm
