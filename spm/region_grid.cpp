#include "spm/region_grid.hpp"

#include <algorithm>
#include <limits>

#include "spm/assert.hpp"

namespace tactus::spm {
namespace {

/// Returns the size of the hash table, such that it is at most half full.
std::size_t buckets_for(std::size_t pages) noexcept {
  std::size_t places = 16;
  while (places < 2 * pages) places *= 2;
  return places;
}

/// Returns the max cell coordinate at depth 0 of a model, by axis.
std::array<double, 3> extent_of(const ModelSummary& summary) noexcept {
  std::array<double, 3> extent{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    // A face on the border of a cell may be in both cells.
    const double cells =
        std::floor((summary.bounds_max[axis] - summary.grid.origin[axis]) / summary.grid.cell_size) + 1;
    extent[axis] = std::clamp<double>(cells, 0, kMaxCellsPerSide - 1);
  }
  return extent;
}

}  // namespace

std::size_t RegionPage::leading(std::span<const Region> regions) noexcept {
  std::size_t count = 0;
  while (count < regions.size() && page_of(regions[count]) == page_of(regions[0])) ++count;
  return count;
}

std::uint64_t RegionPage::bytes(std::span<const Region> regions) noexcept {
  const auto place_of = [&](std::size_t i) { return CellPlace{regions[i].cell, regions[i].depth}; };
  std::size_t labelled = 0;
  bool is_divided = false;
  for (std::size_t i = 0; i < regions.size(); ++i) {
    is_divided = is_divided || regions[i].depth > 0;
    if (i == 0 || place_of(i).around(0) != place_of(i - 1).around(0)) ++labelled;
  }
  return sizeof(RegionPage) + regions.size() * sizeof(Cell) + (is_divided ? labelled * sizeof(std::uint32_t) : 0);
}

RegionPage::RegionPage(PageId id, std::uint32_t first, std::span<const Region> regions) : id_{id}, first_{first} {
  cells_.reserve(regions.size());
  bool is_divided = false;
  for (const Region& region : regions) {
    cells_.push_back({{region.cell, region.depth}, std::uint64_t{region.occupied[1]} << 32 | region.occupied[0]});
    is_divided = is_divided || region.depth > 0;
  }
  const auto count = static_cast<std::uint32_t>(cells_.size());
  for (std::uint32_t region = 0; region < count;) {
    const CellPlace cell = cells_[region].place.around(0);
    const std::uint32_t bit = bit_of(cell.at[0] % kPageSide, cell.at[1] % kPageSide, cell.at[2] % kPageSide);
    labelled_[bit / 64] |= std::uint64_t{1} << bit % 64;
    region = end_of(cell, region, count);
    if (is_divided) ends_.push_back(region);
  }
  ends_.shrink_to_fit();
  for (std::uint32_t word = 1; word < kWords; ++word)
    before_[word] = static_cast<std::uint16_t>(before_[word - 1] + std::popcount(labelled_[word - 1]));
}

RegionGrid::RegionGrid(const GridFrame& frame, std::span<const Region> regions)
    : frame_{frame}, regions_{static_cast<std::uint32_t>(regions.size())} {
  for (const Region& region : regions)
    for (std::size_t axis = 0; axis < 3; ++axis)
      extent_[axis] = std::max(extent_[axis], static_cast<double>(region.cell[axis] >> region.depth));
  while (regions_here_ < regions_) {
    const std::span<const Region> left = regions.subspan(regions_here_);
    const std::size_t count = RegionPage::leading(left);
    owned_.push_back(std::make_unique<const RegionPage>(page_of(left[0]), regions_here_, left.first(count)));
    regions_here_ += static_cast<std::uint32_t>(count);
  }
  owned_.shrink_to_fit();
  pages_.reserve(owned_.size());
  for (const auto& page : owned_) pages_.push_back(page.get());
  buckets_.assign(buckets_for(pages_.size()), nullptr);
  mask_ = static_cast<std::uint32_t>(buckets_.size() - 1);
  for (const RegionPage* page : pages_) insert_bucket(*page);
}

RegionGrid::RegionGrid(const ModelSummary& summary, std::uint32_t max_pages)
    : frame_{summary.grid},
      regions_{summary.regions},
      extent_{extent_of(summary)},
      buckets_(buckets_for(max_pages), nullptr) {
  pages_.reserve(max_pages);
  mask_ = static_cast<std::uint32_t>(buckets_.size() - 1);
}

void RegionGrid::insert_bucket(const RegionPage& page) noexcept {
  std::uint32_t bucket = first_bucket(page.id_);
  while (buckets_[bucket] != nullptr) bucket = (bucket + 1) & mask_;
  buckets_[bucket] = &page;
}

bool RegionGrid::can_insert(const RegionPage& page) const noexcept {
  if (pages_.size() == pages_.capacity() || page.end_region() > regions_) return false;
  const auto next = std::lower_bound(pages_.begin(), pages_.end(), page.id_,
                                     [](const RegionPage* each, PageId id) { return each->id_ < id; });
  const bool is_after_previous = next == pages_.begin() || (*(next - 1))->end_region() <= page.first_;
  const bool is_before_next =
      next == pages_.end() || ((*next)->id_ != page.id_ && page.end_region() <= (*next)->first_);
  return is_after_previous && is_before_next;
}

void RegionGrid::insert(const RegionPage& page) noexcept {
  TACTUS_ASSERT(can_insert(page));
  pages_.insert(std::upper_bound(pages_.begin(), pages_.end(), page.id_,
                                 [](PageId id, const RegionPage* each) { return id < each->id_; }),
                &page);
  insert_bucket(page);
  regions_here_ += page.end_region() - page.first_;
}

void RegionGrid::remove(const RegionPage& page) noexcept {
  const auto at = std::lower_bound(pages_.begin(), pages_.end(), page.id_,
                                   [](const RegionPage* each, PageId id) { return each->id_ < id; });
  TACTUS_ASSERT(at != pages_.end() && *at == &page);
  pages_.erase(at);
  regions_here_ -= page.end_region() - page.first_;
  std::uint32_t hole = first_bucket(page.id_);
  while (buckets_[hole] != &page) hole = (hole + 1) & mask_;
  // Moves later pages into the bucket that becomes empty, so that every search still finds its page.
  for (std::uint32_t next = (hole + 1) & mask_; buckets_[next] != nullptr; next = (next + 1) & mask_) {
    if (((next - first_bucket(buckets_[next]->id_)) & mask_) < ((next - hole) & mask_)) continue;
    buckets_[hole] = buckets_[next];
    hole = next;
  }
  buckets_[hole] = nullptr;
}

std::uint64_t RegionGrid::bytes(std::uint32_t max_pages) noexcept {
  return (max_pages + buckets_for(max_pages)) * sizeof(RegionPage*);
}

std::uint32_t RegionGrid::pages_in_bounds(const ModelSummary& summary) noexcept {
  std::uint32_t pages = 1;
  for (const double extent : extent_of(summary)) pages *= static_cast<std::uint32_t>(extent) / kPageSide + 1;
  return pages;
}

const RegionPage* RegionGrid::page_with(RegionId region) const noexcept {
  const auto after = std::upper_bound(pages_.begin(), pages_.end(), index(region),
                                      [](std::uint32_t id, const RegionPage* page) { return id < page->first_; });
  return after == pages_.begin() ? nullptr : *(after - 1);
}

const RegionPage::Cell& RegionGrid::cell(RegionId region) const noexcept {
  const RegionPage& page = *page_with(region);
  return page.cells_[index(region) - page.first_];
}

double RegionGrid::squared_distance(const Cell& cell, const Vec3d& p) const noexcept {
  const CellBox box = box_of(cell.place);
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
  std::uint64_t left = cell.occupied;
  for (int z = 0; z < 4; ++z)
    for (int y = 0; y < 4; ++y, left >>= 4)
      nearest = std::min(nearest, squared[2][z] + squared[1][y] + squared_x[left & 15u]);
  return nearest;
}

}  // namespace tactus::spm
