#include "spm/region_grid.hpp"

#include <algorithm>
#include <bit>
#include <limits>

namespace tactus::spm {
namespace {

/// Returns the size of the hash table, such that it is at most half full.
std::size_t buckets_for(std::size_t cells) noexcept {
  std::size_t places = 16;
  while (places < 2 * cells) places *= 2;
  return places;
}

}  // namespace

RegionGrid::RegionGrid(const GridFrame& frame, std::span<const Region> regions)
    : frame_{frame}, regions_{static_cast<std::uint32_t>(regions.size())} {
  // Collects the divided cells, each of them once.
  std::vector<Cell> above;
  for (const Region& region : regions)
    for (std::uint32_t up = 1; up <= region.depth; ++up)
      above.push_back(
          {{static_cast<std::uint16_t>(region.cell[0] >> up), static_cast<std::uint16_t>(region.cell[1] >> up),
            static_cast<std::uint16_t>(region.cell[2] >> up)},
           static_cast<std::uint16_t>(region.depth - up),
           0});
  const auto order = [](const Cell& a, const Cell& b) { return a.depth != b.depth ? a.depth < b.depth : a.at < b.at; };
  std::sort(above.begin(), above.end(), order);
  const auto same = [](const Cell& a, const Cell& b) { return a.depth == b.depth && a.at == b.at; };
  above.erase(std::unique(above.begin(), above.end(), same), above.end());

  cells_.reserve(regions.size() + above.size());
  for (const Region& region : regions) {
    cells_.push_back({region.cell, region.depth, std::uint64_t{region.occupied[1]} << 32 | region.occupied[0]});
    for (int axis = 0; axis < 3; ++axis)
      extent_[axis] = std::max(extent_[axis], static_cast<double>(region.cell[axis] >> region.depth));
  }
  cells_.insert(cells_.end(), above.begin(), above.end());
  buckets_.assign(buckets_for(cells_.size()), kNone);
  mask_ = static_cast<std::uint32_t>(buckets_.size() - 1);
  for (std::uint32_t number = 0; number < cells_.size(); ++number) insert(number);
}

void RegionGrid::insert(std::uint32_t number) noexcept {
  const Cell& cell = cells_[number];
  std::uint32_t bucket = first_bucket(cell.depth, cell.at[0], cell.at[1], cell.at[2]);
  while (buckets_[bucket] != kNone) bucket = (bucket + 1) & mask_;
  buckets_[bucket] = number;
}

std::uint64_t RegionGrid::bytes(std::uint32_t regions) noexcept {
  const std::size_t cells = regions + regions / 8;
  return cells * sizeof(Cell) + buckets_for(cells) * sizeof(std::uint32_t);
}

double RegionGrid::squared_distance(RegionId region, const Vec3d& p) const noexcept {
  const CellBox box = box_of(cells_[index(region)]);
  const double quarter = (box.high[0] - box.low[0]) / 4;
  double squared[3][4];  // squared distance along one axis, by axis and quarter
  for (int axis = 0; axis < 3; ++axis)
    for (int i = 0; i < 4; ++i) {
      const double low = box.low[axis] + i * quarter;
      const double d = std::max(std::max(low - p[axis], p[axis] - (low + quarter)), 0.0);
      squared[axis][i] = d * d;
    }
  // Squared distance along x from the nearest occupied subcell of a row, by the four bits of the row.
  constexpr double kFar = std::numeric_limits<double>::infinity();
  double squared_x[16];
  squared_x[0] = kFar;
  for (unsigned bits = 1; bits < 16; ++bits) {
    const auto first = static_cast<unsigned>(std::countr_zero(bits));
    squared_x[bits] = std::min(squared[0][first], squared_x[bits & (bits - 1)]);
  }
  double nearest = kFar;
  std::uint64_t left = cells_[index(region)].occupied;
  for (int z = 0; z < 4; ++z)
    for (int y = 0; y < 4; ++y, left >>= 4)
      nearest = std::min(nearest, squared[2][z] + squared[1][y] + squared_x[left & 15u]);
  return nearest;
}

}  // namespace tactus::spm
