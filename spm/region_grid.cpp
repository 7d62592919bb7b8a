#include "spm/region_grid.hpp"

#include <algorithm>
#include <bit>
#include <limits>

namespace tactus::spm {
namespace {

/// Size of the hash table; at most half full.
std::size_t places_for(std::size_t cells) noexcept {
  std::size_t places = 16;
  while (places < 2 * cells) places *= 2;
  return places;
}

}  // namespace

RegionGrid::RegionGrid(const GridFrame& frame, std::span<const Region> regions)
    : frame_{frame}, regions_{static_cast<std::uint32_t>(regions.size())} {
  // Each divided cell once.
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
  places_.assign(places_for(cells_.size()), kNone);
  mask_ = static_cast<std::uint32_t>(places_.size() - 1);
  for (std::uint32_t number = 0; number < cells_.size(); ++number) enter(number);
}

void RegionGrid::enter(std::uint32_t number) noexcept {
  const Cell& cell = cells_[number];
  std::uint32_t place = home(cell.depth, cell.at[0], cell.at[1], cell.at[2]);
  while (places_[place] != kNone) place = (place + 1) & mask_;
  places_[place] = number;
}

std::uint64_t RegionGrid::bytes(std::uint32_t regions) noexcept {
  const std::size_t cells = regions + regions / 8;
  return cells * sizeof(Cell) + places_for(cells) * sizeof(std::uint32_t);
}

double RegionGrid::squared_distance(RegionId region, const Vec3d& p) const noexcept {
  const CellBox box = box_of(cells_[index(region)]);
  const double quarter = (box.high[0] - box.low[0]) / 4;
  double apart[3][4];  // squared, by axis and quarter
  for (int axis = 0; axis < 3; ++axis)
    for (int i = 0; i < 4; ++i) {
      const double low = box.low[axis] + i * quarter;
      const double d = std::max(std::max(low - p[axis], p[axis] - (low + quarter)), 0.0);
      apart[axis][i] = d * d;
    }
  // By the four bits of a row along x: the nearest set part.
  constexpr double kNever = std::numeric_limits<double>::infinity();
  double along_x[16];
  along_x[0] = kNever;
  for (unsigned bits = 1; bits < 16; ++bits) {
    const auto first = static_cast<unsigned>(std::countr_zero(bits));
    along_x[bits] = std::min(apart[0][first], along_x[bits & (bits - 1)]);
  }
  double nearest = kNever;
  std::uint64_t left = cells_[index(region)].occupied;
  for (int z = 0; z < 4; ++z)
    for (int y = 0; y < 4; ++y, left >>= 4)
      nearest = std::min(nearest, apart[2][z] + apart[1][y] + along_x[left & 15u]);
  return nearest;
}

}  // namespace tactus::spm
