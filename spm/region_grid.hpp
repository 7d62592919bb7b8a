/// Finds the labelled cells that a sphere intersects.
///
/// The even partition of the model's bounds is a sparse grid, and dense cells are divided again. Only cells with faces
/// exist. A sphere intersects a region if it intersects one of the 4 x 4 x 4 parts of the cell that have faces: a tip
/// is larger than a cell, and whole cells would select a third more. Model frame, file units. Queries are O(cells in
/// the bounds of the sphere). Realtime after construction. Source: Liu, Georganas, Roth, 3DIM 2005, section 3.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/ids.hpp"
#include "spm/model.hpp"

namespace tactus::spm {

struct CellBox {
  Vec3d low, high;
  /// 0 inside.
  [[nodiscard]] double squared_distance(const Vec3d& p) const noexcept {
    return (low - p).cwiseMax(p - high).cwiseMax(0.0).squaredNorm();
  }
};

class RegionGrid {
 public:
  /// Allocates. `regions` must have passed violations().
  RegionGrid(const GridFrame& frame, std::span<const Region> regions);

  [[nodiscard]] std::uint32_t size() const noexcept { return regions_; }
  [[nodiscard]] CellBox box(RegionId region) const noexcept { return box_of(cells_[index(region)]); }
  /// Bytes of a grid; assumes one divided cell for eight regions.
  [[nodiscard]] static std::uint64_t bytes(std::uint32_t regions) noexcept;

  /// From `p` to the nearest part of the cell with faces; 0 inside. About 20 ns.
  [[nodiscard]] double squared_distance(RegionId region, const Vec3d& p) const noexcept;

  /// Calls `visit(RegionId, squared distance)` once for each region within `radius` of `centre`, in a fixed order.
  /// False if the visit is not complete: there are more than `kMaxCells` grid cells, a coordinate is not finite, or the
  /// radius is NaN or negative.
  template <class Visit>
  bool for_each_meeting(const Vec3d& centre, double radius, Visit&& visit) const noexcept {
    if (!centre.allFinite() || !(radius >= 0)) return false;
    std::uint32_t low[3], high[3];
    std::uint64_t cells = 1;
    for (int axis = 0; axis < 3; ++axis) {
      const double first = std::floor((centre[axis] - radius - frame_.origin[axis]) / frame_.cell_size - kSlack);
      const double last = std::floor((centre[axis] + radius - frame_.origin[axis]) / frame_.cell_size + kSlack);
      if (!(last >= 0 && first <= extent_[axis])) return true;
      low[axis] = static_cast<std::uint32_t>(std::max(first, 0.0));
      high[axis] = static_cast<std::uint32_t>(std::min<double>(last, extent_[axis]));
      cells *= high[axis] - low[axis] + 1;
    }
    if (cells > kMaxCells) return false;
    const double squared_radius = radius * radius;
    for (std::uint32_t z = low[2]; z <= high[2]; ++z)
      for (std::uint32_t y = low[1]; y <= high[1]; ++y)
        for (std::uint32_t x = low[0]; x <= high[0]; ++x)
          if (look_at(0, {x, y, z}, centre, squared_radius, visit) != kNone)
            visit_divided({x, y, z}, centre, squared_radius, visit);
    return true;
  }
  static constexpr std::uint64_t kMaxCells = 4096;

 private:
  static constexpr int kMaxDepth = 8;
  static constexpr double kSlack = 1e-9;  // of a cell: a sphere that touches a face of a cell intersects the cell

  /// A region or a divided cell.
  struct Cell {
    std::array<std::uint16_t, 3> at;
    std::uint16_t depth;
    std::uint64_t occupied;  // parts that faces intersect
  };

  /// Visits the cell if it is a region. Returns its number if it is divided and within the radius, else kNone.
  template <class Visit>
  [[nodiscard]] std::uint32_t look_at(std::uint32_t depth, const std::array<std::uint32_t, 3>& at, const Vec3d& centre,
                                      double squared_radius, Visit& visit) const noexcept {
    const std::uint32_t found = find(depth, at[0], at[1], at[2]);
    if (found == kNone || box_of(cells_[found]).squared_distance(centre) > squared_radius) return kNone;
    if (found >= regions_) return found;
    const double squared = squared_distance(RegionId{found}, centre);
    if (squared <= squared_radius) visit(RegionId{found}, squared);
    return kNone;
  }

  /// Visits the regions in a divided cell, depth first and children in order. The coordinates of a cell determine its
  /// parent and its child number, so the traversal needs no stack.
  template <class Visit>
  void visit_divided(std::array<std::uint32_t, 3> at, const Vec3d& centre, double squared_radius,
                     Visit& visit) const noexcept {
    std::uint32_t depth = 0;
    bool divided = true;  // the current cell
    for (;;) {
      if (divided && depth < kMaxDepth) {  // go to its first child
        ++depth;
        for (std::uint32_t& x : at) x *= 2;
      } else {  // go to the next child of the nearest ancestor that has one
        while (depth > 0 && (at[0] & at[1] & at[2] & 1u) != 0) {
          --depth;
          for (std::uint32_t& x : at) x /= 2;
        }
        if (depth == 0) return;
        const std::uint32_t child = (at[0] & 1u) + 2 * (at[1] & 1u) + 4 * (at[2] & 1u) + 1;
        for (std::uint32_t axis = 0; axis < 3; ++axis) at[axis] = (at[axis] & ~1u) | (child >> axis & 1u);
      }
      divided = look_at(depth, at, centre, squared_radius, visit) != kNone;
    }
  }

  [[nodiscard]] CellBox box_of(const Cell& cell) const noexcept {
    static constexpr double kShare[kMaxDepth + 1] = {1, 0x1p-1, 0x1p-2, 0x1p-3, 0x1p-4, 0x1p-5, 0x1p-6, 0x1p-7, 0x1p-8};
    const double edge = frame_.cell_size * kShare[cell.depth];
    const Vec3d low = Vec3d{frame_.origin[0], frame_.origin[1], frame_.origin[2]} +
                      edge * Vec3d{double(cell.at[0]), double(cell.at[1]), double(cell.at[2])};
    return {low, low + Vec3d::Constant(edge)};
  }
  [[nodiscard]] std::uint32_t home(std::uint32_t depth, std::uint32_t x, std::uint32_t y,
                                   std::uint32_t z) const noexcept {
    const std::uint64_t key = std::uint64_t{depth} << 57 | std::uint64_t{x} << 38 | std::uint64_t{y} << 19 | z;
    return static_cast<std::uint32_t>(((key ^ key >> 32) * 0x9e3779b97f4a7c15ull) >> 32) & mask_;
  }
  /// Number of the cell, or kNone.
  [[nodiscard]] std::uint32_t find(std::uint32_t depth, std::uint32_t x, std::uint32_t y,
                                   std::uint32_t z) const noexcept {
    for (std::uint32_t place = home(depth, x, y, z);; place = (place + 1) & mask_) {
      const std::uint32_t number = places_[place];
      if (number == kNone) return kNone;
      const Cell& cell = cells_[number];
      if (cell.depth == depth && cell.at[0] == x && cell.at[1] == y && cell.at[2] == z) return number;
    }
  }
  void enter(std::uint32_t number) noexcept;

  GridFrame frame_;
  double extent_[3] = {0, 0, 0};  // highest depth-0 coordinate in use
  std::uint32_t regions_ = 0;
  std::vector<Cell> cells_;            // the regions, then the divided cells
  std::vector<std::uint32_t> places_;  // hash table with open addressing: cell numbers
  std::uint32_t mask_ = 0;
};

}  // namespace tactus::spm
