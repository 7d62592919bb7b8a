#include "spm/region_grid.hpp"

#include <algorithm>
#include <limits>

namespace tactus::spm {
namespace {

/// Returns the size of the hash table, such that it is at most half full.
std::size_t buckets_for(std::size_t pages) noexcept {
  std::size_t places = 16;
  while (places < 2 * pages) places *= 2;
  return places;
}

}  // namespace

RegionGrid::RegionGrid(const GridFrame& frame, std::span<const Region> regions) : frame_{frame} {
  cells_.reserve(regions.size());
  for (const Region& region : regions) {
    cells_.push_back({{region.cell, region.depth}, std::uint64_t{region.occupied[1]} << 32 | region.occupied[0]});
    for (std::size_t axis = 0; axis < 3; ++axis)
      extent_[axis] = std::max(extent_[axis], static_cast<double>(region.cell[axis] >> region.depth));
  }
  const auto key_at = [this](std::uint32_t region) { return key_of(cells_[region].place); };
  for (std::uint32_t first = 0, end = 0; first < size(); first = end) {
    while (end < size() && key_at(end) == key_at(first)) ++end;
    add_page(key_at(first), first, end);
  }
  pages_.shrink_to_fit();
  ends_.shrink_to_fit();
  buckets_.assign(buckets_for(pages_.size()), kNone);
  mask_ = static_cast<std::uint32_t>(buckets_.size() - 1);
  for (std::uint32_t page = 0; page < pages_.size(); ++page) {
    std::uint32_t bucket = first_bucket(pages_[page].key);
    while (buckets_[bucket] != kNone) bucket = (bucket + 1) & mask_;
    buckets_[bucket] = page;
  }
}

void RegionGrid::add_page(std::uint64_t key, std::uint32_t first_region, std::uint32_t end_region) {
  Page page{.key = key, .first_region = first_region};
  const auto divided = [](const Cell& cell) { return cell.place.depth > 0; };
  if (std::any_of(cells_.begin() + first_region, cells_.begin() + end_region, divided))
    page.ends = static_cast<std::uint32_t>(ends_.size());
  for (std::uint32_t region = first_region; region < end_region;) {
    const Place cell = cells_[region].place.around(0);
    const std::uint32_t bit = bit_of(cell.at[0] % kPageSide, cell.at[1] % kPageSide, cell.at[2] % kPageSide);
    page.labelled[bit / 64] |= std::uint64_t{1} << bit % 64;
    region = end_of(cell, region, end_region);
    if (page.ends != kNone) ends_.push_back(region);
  }
  for (std::uint32_t word = 1; word < Page::kWords; ++word)
    page.before[word] = static_cast<std::uint16_t>(page.before[word - 1] + std::popcount(page.labelled[word - 1]));
  pages_.push_back(page);
}

std::uint64_t RegionGrid::bytes(std::uint32_t regions) noexcept {
  const std::size_t pages = regions / 40 + 1;
  return regions * sizeof(Cell) + pages * sizeof(Page) + buckets_for(pages) * sizeof(std::uint32_t) +
         regions / 4 * sizeof(std::uint32_t);
}

std::uint64_t RegionGrid::bytes(std::span<const Region> regions) noexcept {
  std::size_t pages = 0, ends = 0;
  for (std::size_t first = 0; first < regions.size(); ++pages) {
    const auto place_of = [&](std::size_t region) { return Place{regions[region].cell, regions[region].depth}; };
    std::size_t cells = 0;
    bool is_divided = false;
    std::size_t end = first;
    for (; end < regions.size() && key_of(place_of(end)) == key_of(place_of(first)); ++end) {
      is_divided = is_divided || regions[end].depth > 0;
      if (end == first || place_of(end).around(0) != place_of(end - 1).around(0)) ++cells;
    }
    if (is_divided) ends += cells;
    first = end;
  }
  return regions.size() * sizeof(Cell) + pages * sizeof(Page) + (buckets_for(pages) + ends) * sizeof(std::uint32_t);
}

double RegionGrid::squared_distance(RegionId region, const Vec3d& p) const noexcept {
  const CellBox box = this->box(region);
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
