/// The original surface for an audit: all its triangles, exact distances, and a grid to find them.
///
/// It deliberately shares no geometry code with the run time, so that one error cannot affect both. Model frame, file
/// units.
#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace tactus::tools {

using Point = std::array<double, 3>;
/// Three corners, x y z each, as in the file.
using Corners = std::array<float, 9>;

/// Distance of a point from a triangle, which may be degenerate: the minimum over the three edges and, if it lies
/// inside, the foot of the perpendicular. The foot solves the normal equations of its barycentric coordinates. Extended
/// precision, so a needle costs no accuracy.
[[nodiscard]] double distance_to_triangle(const Point& point, const Corners& triangle) noexcept;

/// Finds the triangles near a point in a hierarchy of hash grids. Each triangle is in one grid cell, of the finest grid
/// whose cells are at least as wide as the triangle.
class SurfaceGrid {
 public:
  struct Near {
    std::uint32_t triangle;
    double distance;
  };

  /// Borrows `triangles`, which must be finite. Fast for distances up to about `reach` > 0. O(n log n).
  SurfaceGrid(const std::vector<Corners>& triangles, double reach);

  /// All triangles no further than `distance` from `point`, by ascending number.
  void within(const Point& point, double distance, std::vector<Near>& out) const;
  /// True when there is such a triangle; stops at the first.
  [[nodiscard]] bool touches(const Point& point, double distance) const;

 private:
  struct Level {
    double cell;  ///< width
    std::array<std::uint32_t, 3> last{};
    std::unordered_map<std::uint64_t, std::uint32_t> first;  ///< of each cell's triangles in `order_`
  };
  struct Box {
    Point low, high;
  };
  [[nodiscard]] static Box box_of(const Corners& triangle) noexcept;
  /// Calls `visit(triangle, distance)` for each triangle within `distance` until it returns true.
  template <class Visit>
  void search(const Point& point, double distance, Visit&& visit) const;

  const std::vector<Corners>& triangles_;
  Point low_{};
  std::vector<Level> levels_;
  std::vector<std::uint32_t> order_;  ///< triangles, by grid and cell of the grid
  std::vector<std::uint64_t> keys_;   ///< of the cell of each entry in `order_`
};

}  // namespace tactus::tools
