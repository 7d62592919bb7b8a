#include "spm/region_grid.hpp"

namespace tactus::spm {

RegionGrid::RegionGrid(const GridFrame& frame, Span<const Region> regions)
    : frame_{frame}, cells_{static_cast<std::uint32_t>(regions.size()) * 2 + 16} {
  // Dividing cells add up to kMaxDepth entries each in the worst case; count them first so that the table fits.
  std::uint32_t dividing = 0;
  for (const Region& region : regions) dividing += region.depth;
  if (dividing > 0) cells_ = FlatIndex{static_cast<std::uint32_t>(regions.size()) + dividing + 16};

  boxes_.reserve(regions.size());
  for (std::uint32_t i = 0; i < regions.size(); ++i) {
    const Region& region = regions[i];
    const double edge = frame.cell_size / static_cast<double>(1u << region.depth);
    boxes_.push_back(box_of(region.cell[0], region.cell[1], region.cell[2], edge));
    cells_.insert(key(region.depth, region.cell[0], region.cell[1], region.cell[2]), i);
    for (std::uint32_t up = 1; up <= region.depth; ++up) {
      const std::uint64_t above =
          key(region.depth - up, region.cell[0] >> up, region.cell[1] >> up, region.cell[2] >> up);
      if (cells_.find(above) != kNone) break;
      cells_.insert(above, kDivided);
    }
    for (int axis = 0; axis < 3; ++axis)
      extent_[axis] = std::max(extent_[axis], static_cast<double>(region.cell[axis] >> region.depth));
  }
}

CellBox RegionGrid::box_of(std::uint32_t x, std::uint32_t y, std::uint32_t z, double edge) const noexcept {
  const Vec3d origin{frame_.origin[0], frame_.origin[1], frame_.origin[2]};
  const Vec3d low = origin + edge * Vec3d{static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)};
  return {low, low + Vec3d::Constant(edge)};
}

}  // namespace tactus::spm
