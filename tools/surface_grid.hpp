/// Finds the triangles of the original surface near a point, for an audit.
///
/// Shares no geometry code with an HRTC, so that no error can affect both audit and HRTC. Model frame, file units.
#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace tactus::tools {

using Point = std::array<double, 3>;
/// Coordinates of three corners, x y z each, as in the file.
using Corners = std::array<float, 9>;

/// Returns the distance of a point from a triangle, which may be degenerate. It is the minimum of the distances to the
/// three edges and, if the foot of the perpendicular is inside the triangle, to the foot. Computes in extended
/// precision, so that it is accurate for thin triangles too.
[[nodiscard]] double distance_to_triangle(const Point& point, const Corners& triangle) noexcept;

/// A hierarchy of hash grids. Each triangle is in one cell of the finest grid whose cells are at least as wide as the
/// triangle: the cell of its box's low corner.
class SurfaceGrid {
 public:
  struct Near {
    std::uint32_t triangle;
    double distance;
  };

  /// `triangles` must be finite and must outlive this. Queries are fast for distances up to about `reach`, which must
  /// be above 0. O(n log n).
  SurfaceGrid(const std::vector<Corners>& triangles, double reach);

  /// Fills `out` with all triangles within `distance` of `point`, in ascending order.
  void within(const Point& point, double distance, std::vector<Near>& out) const;
  /// Returns whether a triangle is within `distance` of `point`.
  [[nodiscard]] bool touches(const Point& point, double distance) const;

 private:
  struct Level {
    double cell_size;
    std::array<std::uint32_t, 3> last{};  ///< index of the last cell on each axis
    std::unordered_map<std::uint64_t, std::uint32_t>
        first;  ///< by key of a cell: index of its first triangle in `order_`
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
  std::vector<std::uint32_t> order_;  ///< triangles, sorted by grid and cell
  std::vector<std::uint64_t> keys_;   ///< key of the cell of each entry in `order_`
};

}  // namespace tactus::tools
