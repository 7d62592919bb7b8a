/// Which labelled cells a ball meets.
///
/// The even partition of the bounding volume is a sparse grid whose dense cells are divided again; only cells that hold
/// faces exist. A cell is met where its surface may be: in those of its sixty-fourths that faces meet. (A tip is larger
/// than a cell; whole cells would add a third to what it wants.) Model frame, file units. Look-ups are O(cells of the
/// grid in the ball's box). Realtime after construction. Source: Liu, Georganas, Roth, 3DIM 2005, section 3.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "spm/flat_index.hpp"
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
  RegionGrid(const GridFrame& frame, Span<const Region> regions);

  [[nodiscard]] std::uint32_t size() const noexcept { return static_cast<std::uint32_t>(boxes_.size()); }
  [[nodiscard]] const CellBox& box(RegionId region) const noexcept { return boxes_[index(region)]; }

  /// From `p` to the nearest part of the cell that faces meet; 0 inside. About 20 ns.
  [[nodiscard]] double squared_distance(RegionId region, const Vec3d& p) const noexcept;

  /// Calls `visit(RegionId, squared distance)` once for each labelled cell that is no further than `radius` from
  /// `centre`, in a fixed order. Stops after `kMaxCells` grid cells and returns false: then not all were visited.
  template <class Visit>
  bool for_each_meeting(const Vec3d& centre, double radius, Visit&& visit) const noexcept {
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
        for (std::uint32_t x = low[0]; x <= high[0]; ++x) visit_cell(0, x, y, z, centre, squared_radius, visit);
    return true;
  }
  static constexpr std::uint64_t kMaxCells = 4096;

 private:
  static constexpr int kMaxDepth = 8;
  static constexpr std::uint32_t kDivided = kNone - 1;
  static constexpr double kSlack = 1e-9;  // of a cell: a ball that touches a cell's face meets it

  [[nodiscard]] static std::uint64_t key(std::uint32_t depth, std::uint32_t x, std::uint32_t y,
                                         std::uint32_t z) noexcept {
    return std::uint64_t{depth} << 57 | std::uint64_t{x} << 38 | std::uint64_t{y} << 19 | z;
  }

  template <class Visit>
  void visit_cell(std::uint32_t depth, std::uint32_t x, std::uint32_t y, std::uint32_t z, const Vec3d& centre,
                  double squared_radius, Visit& visit) const noexcept {
    const std::uint32_t found = cells_.find(key(depth, x, y, z));
    if (found == kNone) return;
    if (found != kDivided) {
      if (boxes_[found].squared_distance(centre) > squared_radius) return;
      const double squared = squared_distance(RegionId{found}, centre);
      if (squared <= squared_radius) visit(RegionId{found}, squared);
      return;
    }
    const double edge = frame_.cell_size / static_cast<double>(1u << depth);
    const CellBox box = box_of(x, y, z, edge);
    if (box.squared_distance(centre) > squared_radius) return;
    for (std::uint32_t child = 0; child < 8; ++child)
      visit_cell(depth + 1, 2 * x + (child & 1), 2 * y + (child >> 1 & 1), 2 * z + (child >> 2), centre, squared_radius,
                 visit);
  }

  [[nodiscard]] CellBox box_of(std::uint32_t x, std::uint32_t y, std::uint32_t z, double edge) const noexcept;

  GridFrame frame_;
  double extent_[3] = {0, 0, 0};  // highest depth-0 coordinate in use
  FlatIndex cells_;
  std::vector<CellBox> boxes_;
  std::vector<std::uint64_t> occupied_;
};

}  // namespace tactus::spm
