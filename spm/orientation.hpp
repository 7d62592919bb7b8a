/// Computes the exact signs of determinants of points.
///
/// If the value in double precision exceeds its error bound, its sign is returned. Otherwise the determinant is
/// computed exactly, as a sum of doubles that do not overlap. The sign is exact unless a product of three differences
/// overflows or underflows. Any frame and unit. Realtime: about 10 ns, or a few microseconds if points are almost
/// coplanar.
/// Source: Shewchuk, Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates, 1997.
#pragma once

#include "spm/model.hpp"

namespace tactus::spm {

/// Returns the sign of (b - a) x (c - a) . (d - a): 1 if abc is counter-clockwise seen from d, 0 if all four are
/// coplanar.
[[nodiscard]] int orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) noexcept;

/// Returns the sign of the area of abc in the plane of the coordinates `x` and `y` (0, 1 or 2): 1 if abc is
/// counter-clockwise, 0 if the projected points are collinear.
[[nodiscard]] int orientation(const Vec3d& a, const Vec3d& b, const Vec3d& c, int x, int y) noexcept;

}  // namespace tactus::spm
