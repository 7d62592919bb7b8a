#include "spm/region_grid.hpp"

#include <limits>

namespace tactus::spm {

RegionGrid::RegionGrid(const GridFrame& frame, Span<const Region> regions)
    : frame_{frame}, cells_{static_cast<std::uint32_t>(regions.size()) * 2 + 16} {
  // Dividing cells add up to kMaxDepth entries each in the worst case; count them first so that the table fits.
  std::uint32_t dividing = 0;
  for (const Region& region : regions) dividing += region.depth;
  if (dividing > 0) cells_ = FlatIndex{static_cast<std::uint32_t>(regions.size()) + dividing + 16};

  boxes_.reserve(regions.size());
  occupied_.reserve(regions.size());
  for (std::uint32_t i = 0; i < regions.size(); ++i) {
    const Region& region = regions[i];
    const double edge = frame.cell_size / static_cast<double>(1u << region.depth);
    boxes_.push_back(box_of(region.cell[0], region.cell[1], region.cell[2], edge));
    occupied_.push_back(std::uint64_t{region.occupied[1]} << 32 | region.occupied[0]);
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

double RegionGrid::squared_distance(RegionId region, const Vec3d& p) const noexcept {
  const CellBox& box = boxes_[index(region)];
  const double quarter = (box.high[0] - box.low[0]) / 4;
  double apart[3][4];  // squared, by axis and quarter
  for (int axis = 0; axis < 3; ++axis)
    for (int i = 0; i < 4; ++i) {
      const double low = box.low[axis] + i * quarter;
      const double d = std::max(std::max(low - p[axis], p[axis] - (low + quarter)), 0.0);
      apart[axis][i] = d * d;
    }
  // By the four bits of a row along x: the nearest of those set.
  constexpr double kNever = std::numeric_limits<double>::infinity();
  double along_x[16];
  along_x[0] = kNever;
  for (unsigned bits = 1; bits < 16; ++bits) {
    const auto first = static_cast<unsigned>(__builtin_ctz(bits));
    along_x[bits] = std::min(apart[0][first], along_x[bits & (bits - 1)]);
  }
  double nearest = kNever;
  std::uint64_t left = occupied_[index(region)];
  for (int z = 0; z < 4; ++z)
    for (int y = 0; y < 4; ++y, left >>= 4)
      nearest = std::min(nearest, apart[2][z] + apart[1][y] + along_x[left & 15u]);
  return nearest;
}

CellBox RegionGrid::box_of(std::uint32_t x, std::uint32_t y, std::uint32_t z, double edge) const noexcept {
  const Vec3d origin{frame_.origin[0], frame_.origin[1], frame_.origin[2]};
  const Vec3d low = origin + edge * Vec3d{static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)};
  return {low, low + Vec3d::Constant(edge)};
}

}  // namespace tactus::spm
