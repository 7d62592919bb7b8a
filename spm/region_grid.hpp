/// Finds the regions that a sphere intersects.
///
/// The grid stores only labelled cells and the divided cells above them. A sphere intersects a region if it intersects
/// an occupied subcell (Region::occupied) of its cell. A test of whole cells would select a third more regions.
///
/// Model frame, file units. Queries are O(cells in the bounds of the sphere). Realtime after construction.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3.
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
  /// The squared distance of `p` from the box; 0 inside.
  [[nodiscard]] double squared_distance(const Vec3d& p) const noexcept {
    return (low - p).cwiseMax(p - high).cwiseMax(0.0).squaredNorm();
  }
};

/// The bounds of a model's vertices.
[[nodiscard]] inline CellBox bounds_of(const ModelSummary& summary) noexcept {
  const auto wide = [](const std::array<float, 3>& p) { return Vec3d{p[0], p[1], p[2]}; };
  return {wide(summary.bounds_min), wide(summary.bounds_max)};
}

class RegionGrid {
 public:
  /// Allocates. `regions` must have passed violations().
  RegionGrid(const GridFrame& frame, std::span<const Region> regions);

  [[nodiscard]] std::uint32_t size() const noexcept { return regions_; }
  [[nodiscard]] CellBox box(RegionId region) const noexcept { return box_of(cells_[index(region)]); }
  /// Estimates the bytes of a grid. Assumes one divided cell for each eight regions.
  [[nodiscard]] static std::uint64_t bytes(std::uint32_t regions) noexcept;

  /// The squared distance of `p` from the nearest occupied subcell; 0 inside. About 20 ns.
  [[nodiscard]] double squared_distance(RegionId region, const Vec3d& p) const noexcept;

  /// Calls `visit(RegionId, squared distance)` once for each region within `radius` of `centre`, in a fixed order. If
  /// the bounds of the sphere contain more than `kMaxCells` cells of depth 0, a coordinate is not finite, or the radius
  /// is NaN or negative, returns false and visits nothing.
  template <class Visit>
  bool for_each_intersecting(const Vec3d& centre, double radius, Visit&& visit) const noexcept {
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
          if (visit_cell(0, {x, y, z}, centre, squared_radius, visit) != kNone)
            visit_children({x, y, z}, centre, squared_radius, visit);
    return true;
  }
  static constexpr std::uint64_t kMaxCells = 4096;

 private:
  static constexpr int kMaxDepth = 8;
  // The bounds of a sphere grow by this share of a cell, so that rounding hides no cell that the sphere touches.
  static constexpr double kSlack = 1e-9;

  /// A region or a divided cell.
  struct Cell {
    std::array<std::uint16_t, 3> at;  // x, y, z at its depth
    std::uint16_t depth;
    std::uint64_t occupied;  // bits as in Region::occupied; 0 for a divided cell
  };

  /// If the cell is a region within the radius, visits it and returns kNone. If the cell is divided and within the
  /// radius, returns its index in cells_. Otherwise returns kNone.
  template <class Visit>
  [[nodiscard]] std::uint32_t visit_cell(std::uint32_t depth, const std::array<std::uint32_t, 3>& at,
                                         const Vec3d& centre, double squared_radius, Visit& visit) const noexcept {
    const std::uint32_t found = find(depth, at[0], at[1], at[2]);
    if (found == kNone || box_of(cells_[found]).squared_distance(centre) > squared_radius) return kNone;
    if (found >= regions_) return found;
    const double squared = squared_distance(RegionId{found}, centre);
    if (squared <= squared_radius) visit(RegionId{found}, squared);
    return kNone;
  }

  /// Visits the regions in a divided cell of depth 0, depth first. The coordinates of a cell determine its parent and
  /// its siblings, so the traversal needs no stack.
  template <class Visit>
  void visit_children(std::array<std::uint32_t, 3> at, const Vec3d& centre, double squared_radius,
                      Visit& visit) const noexcept {
    std::uint32_t depth = 0;
    bool is_divided = true;  // for the cell `at`
    for (;;) {
      if (is_divided && depth < kMaxDepth) {  // continue with the first child
        ++depth;
        for (std::uint32_t& x : at) x *= 2;
      } else {  // continue with the next sibling of the cell or of its nearest ancestor that has one
        while (depth > 0 && (at[0] & at[1] & at[2] & 1u) != 0) {
          --depth;
          for (std::uint32_t& x : at) x /= 2;
        }
        if (depth == 0) return;
        const std::uint32_t child = (at[0] & 1u) + 2 * (at[1] & 1u) + 4 * (at[2] & 1u) + 1;
        for (std::uint32_t axis = 0; axis < 3; ++axis) at[axis] = (at[axis] & ~1u) | (child >> axis & 1u);
      }
      is_divided = visit_cell(depth, at, centre, squared_radius, visit) != kNone;
    }
  }

  [[nodiscard]] CellBox box_of(const Cell& cell) const noexcept {
    static constexpr double kShare[kMaxDepth + 1] = {1, 0x1p-1, 0x1p-2, 0x1p-3, 0x1p-4, 0x1p-5, 0x1p-6, 0x1p-7, 0x1p-8};
    const double edge = frame_.cell_size * kShare[cell.depth];
    const Vec3d low = Vec3d{frame_.origin[0], frame_.origin[1], frame_.origin[2]} +
                      edge * Vec3d{double(cell.at[0]), double(cell.at[1]), double(cell.at[2])};
    return {low, low + Vec3d::Constant(edge)};
  }
  [[nodiscard]] std::uint32_t first_bucket(std::uint32_t depth, std::uint32_t x, std::uint32_t y,
                                           std::uint32_t z) const noexcept {
    const std::uint64_t key = std::uint64_t{depth} << 57 | std::uint64_t{x} << 38 | std::uint64_t{y} << 19 | z;
    return static_cast<std::uint32_t>(((key ^ key >> 32) * 0x9e3779b97f4a7c15ull) >> 32) & mask_;
  }
  /// The index of the cell in cells_, or kNone.
  [[nodiscard]] std::uint32_t find(std::uint32_t depth, std::uint32_t x, std::uint32_t y,
                                   std::uint32_t z) const noexcept {
    for (std::uint32_t bucket = first_bucket(depth, x, y, z);; bucket = (bucket + 1) & mask_) {
      const std::uint32_t number = buckets_[bucket];
      if (number == kNone) return kNone;
      const Cell& cell = cells_[number];
      if (cell.depth == depth && cell.at[0] == x && cell.at[1] == y && cell.at[2] == z) return number;
    }
  }
  void insert(std::uint32_t number) noexcept;

  GridFrame frame_;
  double extent_[3] = {0, 0, 0};  // max cell coordinate at depth 0, by axis
  std::uint32_t regions_ = 0;
  std::vector<Cell> cells_;             // the regions by RegionId, then the divided cells
  std::vector<std::uint32_t> buckets_;  // hash table with open addressing: indices in cells_, or kNone
  std::uint32_t mask_ = 0;
};

}  // namespace tactus::spm
