/// Finds the regions that a sphere intersects.
///
/// The grid consists of pages. A page is a cube of 8 x 8 x 8 cells of depth 0 with a bit for each of them. Regions are
/// in Morton order, so those of a page and those of a cell are consecutive. A sphere intersects a region if it
/// intersects an occupied subcell (Region::occupied) of its cell. A test of whole cells would select a third more
/// regions.
///
/// A grid has all pages of a model, or those that were inserted. Of a missing page it does not know whether it contains
/// regions.
///
/// Model frame, file units. Queries are O(cells in the bounds of the sphere). `box` and `squared_distance` find the
/// page of a region in O(log pages). Realtime after construction.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <type_traits>
#include <vector>

#include "spm/hash_multiplier.hpp"
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

/// A cell of any depth.
struct CellPlace {
  std::array<std::uint16_t, 3> at;  ///< x, y, z at its depth
  std::uint16_t depth;

  /// The cell of the given smaller depth around this one.
  [[nodiscard]] CellPlace around(std::uint32_t smaller) const noexcept {
    const std::uint32_t up = depth - smaller;
    return {{static_cast<std::uint16_t>(at[0] >> up), static_cast<std::uint16_t>(at[1] >> up),
             static_cast<std::uint16_t>(at[2] >> up)},
            static_cast<std::uint16_t>(smaller)};
  }
  [[nodiscard]] bool operator==(const CellPlace&) const noexcept = default;
};

/// The regions in a cube of 8 x 8 x 8 cells of depth 0. Constant.
class RegionPage {
 public:
  /// `regions`: all regions of the page, in the order of their ids, which begin with `first`. They must have passed
  /// violations(). Allocates.
  RegionPage(PageId id, std::uint32_t first, std::span<const Region> regions);
  explicit RegionPage(const Page& page) : RegionPage{page.id, page.first, page.regions} {}
  [[nodiscard]] bool operator==(const RegionPage&) const noexcept = default;

  /// Returns the number of regions at the beginning of `regions` that are in one page.
  [[nodiscard]] static std::size_t leading(std::span<const Region> regions) noexcept;

  [[nodiscard]] PageId id() const noexcept { return id_; }

  [[nodiscard]] std::uint32_t first_region() const noexcept { return first_; }
  [[nodiscard]] std::uint32_t end_region() const noexcept { return first_ + static_cast<std::uint32_t>(cells_.size()); }
  [[nodiscard]] std::uint64_t bytes() const noexcept {
    return sizeof(RegionPage) + cells_.size() * sizeof(Cell) + ends_.size() * sizeof(std::uint32_t);
  }
  /// Returns the bytes of a page with these regions.
  [[nodiscard]] static std::uint64_t bytes(std::span<const Region> regions) noexcept;

 private:
  friend class RegionGrid;
  struct Cell {
    CellPlace place;
    std::uint64_t occupied;  // bits as in Region::occupied
    [[nodiscard]] bool operator==(const Cell&) const noexcept = default;
  };

 public:
  static constexpr std::size_t kBytesPerRegion = sizeof(Cell);

 private:
  static constexpr std::uint32_t kWords = kPageSide * kPageSide * kPageSide / 64;

  /// The Morton code of a cell in its page.
  [[nodiscard]] static std::uint32_t bit_of(std::uint32_t x, std::uint32_t y, std::uint32_t z) noexcept {
    static constexpr std::array<std::uint32_t, kPageSide> kSpread{0, 1, 8, 9, 64, 65, 72, 73};
    return kSpread[x] | kSpread[y] << 1 | kSpread[z] << 2;
  }
  /// Returns the index of the first cell after those in `cell`. The cell at `first` is in it; all cells to before `end`
  /// are in the same cell of depth 0.
  [[nodiscard]] std::uint32_t end_of(const CellPlace& cell, std::uint32_t first, std::uint32_t end) const noexcept {
    const auto is_inside = [&cell](const Cell& region) {
      return region.place.depth >= cell.depth && region.place.around(cell.depth) == cell;
    };
    const auto at = cells_.begin();
    return static_cast<std::uint32_t>(std::partition_point(at + first, at + end, is_inside) - at);
  }

  PageId id_;
  std::uint32_t first_;
  std::array<std::uint16_t, kWords> before_{};    // number of labelled cells in the words before this one
  std::array<std::uint64_t, kWords> labelled_{};  // a bit for each cell of depth 0, in Morton order
  std::vector<Cell> cells_;                       // by region
  std::vector<std::uint32_t> ends_;  // if a cell is divided: index after the last region of each labelled cell
};

class RegionGrid {
 public:
  /// Makes a grid with all pages. Allocates. `regions` must have passed violations().
  RegionGrid(const GridFrame& frame, std::span<const Region> regions);
  /// Makes a grid without pages, for at most `max_pages`. `summary` must have passed violations(). Allocates.
  RegionGrid(const ModelSummary& summary, std::uint32_t max_pages);

  /// Returns whether the grid has room for the page, has no page with this id, and no page with one of its regions.
  [[nodiscard]] bool can_insert(const RegionPage& page) const noexcept;
  /// Inserts a page, which must live until it is removed. `can_insert` must be true. O(pages). Realtime.
  void insert(const RegionPage& page) noexcept;
  /// Removes an inserted page. O(pages). Realtime.
  void remove(const RegionPage& page) noexcept;

  /// Returns null if the grid does not have the page.
  [[nodiscard]] const RegionPage* find(PageId page) const noexcept {
    for (std::uint32_t bucket = first_bucket(page);; bucket = (bucket + 1) & mask_)
      if (buckets_[bucket] == nullptr || buckets_[bucket]->id_ == page) return buckets_[bucket];
  }
  [[nodiscard]] std::size_t pages() const noexcept { return pages_.size(); }
  /// Number of regions of the model.
  [[nodiscard]] std::uint32_t size() const noexcept { return regions_; }
  /// Whether the grid has the page that contains the region.
  [[nodiscard]] bool has(RegionId region) const noexcept {
    const auto page = page_with(region);
    return page != nullptr && index(region) < page->end_region();
  }
  [[nodiscard]] CellBox box(RegionId region) const noexcept { return box_of(cell(region).place); }
  /// Returns the bytes of a grid for this number of pages, without its pages.
  [[nodiscard]] static std::uint64_t bytes(std::uint32_t max_pages) noexcept;
  /// Returns the number of pages that a grid of the model can have, at most kPageIds.
  [[nodiscard]] static std::uint32_t pages_in_bounds(const ModelSummary& summary) noexcept;

  /// The squared distance of `p` from the nearest occupied subcell; 0 inside. About 40 ns.
  [[nodiscard]] double squared_distance(RegionId region, const Vec3d& p) const noexcept {
    return squared_distance(cell(region), p);
  }

  /// Calls `visit(RegionId, squared distance)` once for each region within `radius` of `centre`, in a fixed order; or
  /// `visit(RegionId, squared distance, CellBox)`, if it takes the box of the cell, too. If the bounds of the sphere
  /// contain more than `kMaxCells` cells of depth 0, a coordinate is not finite, or the radius is NaN or negative,
  /// returns false and visits nothing. Also returns false after `kMaxTests` tests of regions; then `visit` was called
  /// for some of them only. Visits no region of a missing page.
  template <class Visit>
  bool for_each_intersecting(const Vec3d& centre, double radius, Visit&& visit) const noexcept {
    if (!centre.allFinite() || !(radius >= 0)) return false;
    Coordinates low, high;
    if (!bounds(centre, radius, low, high)) return true;
    std::uint64_t cells = 1;
    for (std::size_t axis = 0; axis < 3; ++axis) cells *= high[axis] - low[axis] + 1;
    if (cells > kMaxCells) return false;
    std::uint32_t tests_left = kMaxTests;
    for (std::uint32_t z = low[2] / kPageSide; z <= high[2] / kPageSide; ++z)
      for (std::uint32_t y = low[1] / kPageSide; y <= high[1] / kPageSide; ++y)
        for (std::uint32_t x = low[0] / kPageSide; x <= high[0] / kPageSide; ++x)
          if (const RegionPage* page = find(page_at(x, y, z)))
            visit_page(*page, {x, y, z}, low, high, centre, radius * radius, visit, tests_left);
    return tests_left > 0;
  }
  /// Returns whether the grid has all pages that the bounds of a sphere meet. The sphere must not be too large for
  /// `for_each_intersecting`.
  [[nodiscard]] bool has_pages(const Vec3d& centre, double radius) const noexcept {
    if (is_complete()) return true;
    Coordinates low, high;
    if (!bounds(centre, radius, low, high)) return true;
    bool has_all = true;
    for (std::uint32_t z = low[2] / kPageSide; z <= high[2] / kPageSide; ++z)
      for (std::uint32_t y = low[1] / kPageSide; y <= high[1] / kPageSide; ++y)
        for (std::uint32_t x = low[0] / kPageSide; x <= high[0] / kPageSide; ++x)
          has_all = has_all && find(page_at(x, y, z)) != nullptr;
    return has_all;
  }
  /// Calls `visit(PageId, page)` for each page that a sphere meets; `page` is null if the grid does not have it. Visits
  /// nothing if the bounds of the sphere meet more than `kMaxCells` pages.
  template <class Visit>
  void for_each_page(const Vec3d& centre, double radius, Visit&& visit) const {
    Coordinates low, high;
    if (!centre.allFinite() || !(radius >= 0) || !bounds(centre, radius, low, high)) return;
    std::uint64_t pages = 1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] /= kPageSide;
      high[axis] /= kPageSide;
      pages *= high[axis] - low[axis] + 1;
    }
    if (pages > kMaxCells) return;
    const double edge = kPageSide * frame_.cell_size;
    for (std::uint32_t z = low[2]; z <= high[2]; ++z)
      for (std::uint32_t y = low[1]; y <= high[1]; ++y)
        for (std::uint32_t x = low[0]; x <= high[0]; ++x) {
          const Vec3d corner = Vec3d{frame_.origin[0], frame_.origin[1], frame_.origin[2]} +
                               edge * Vec3d{double(x), double(y), double(z)};
          const CellBox box{corner, corner + Vec3d::Constant(edge)};
          const double reach = radius + kSlack * edge;
          if (box.squared_distance(centre) <= reach * reach) visit(page_at(x, y, z), find(page_at(x, y, z)));
        }
  }
  static constexpr std::uint64_t kMaxCells = 4096;
  static constexpr std::uint32_t kMaxTests = 8192;

 private:
  // The bounds of a sphere grow by this share of a cell, so that rounding hides no cell that the sphere touches.
  static constexpr double kSlack = 1e-9;

  using Coordinates = std::array<std::uint32_t, 3>;
  using Cell = RegionPage::Cell;

  /// Sets the first and the last cell of depth 0 in the bounds of a sphere. Returns false if there is none in the grid.
  [[nodiscard]] bool bounds(const Vec3d& centre, double radius, Coordinates& low, Coordinates& high) const noexcept {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double at = centre[static_cast<int>(axis)] - frame_.origin[axis];
      const double first = std::floor((at - radius) / frame_.cell_size - kSlack);
      const double last = std::floor((at + radius) / frame_.cell_size + kSlack);
      if (!(last >= 0 && first <= extent_[axis])) return false;
      low[axis] = static_cast<std::uint32_t>(std::max(first, 0.0));
      high[axis] = static_cast<std::uint32_t>(std::min<double>(last, extent_[axis]));
    }
    return true;
  }
  /// Whether all regions are in the pages of the grid, so that the other pages contain none.
  [[nodiscard]] bool is_complete() const noexcept { return regions_here_ == regions_; }
  /// The last page that begins with the region or before it, or null.
  [[nodiscard]] const RegionPage* page_with(RegionId region) const noexcept;
  void insert_bucket(const RegionPage& page) noexcept;

  /// Visits the regions of a page in the cells from `low` to `high`.
  template <class Visit>
  void visit_page(const RegionPage& page, const Coordinates& at, const Coordinates& low, const Coordinates& high,
                  const Vec3d& centre, double squared_radius, Visit& visit, std::uint32_t& tests_left) const noexcept {
    Coordinates first, last;  // relative to the page
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::uint32_t begin = at[axis] * kPageSide;
      first[axis] = std::max(low[axis], begin) - begin;
      last[axis] = std::min(high[axis], begin + kPageSide - 1) - begin;
    }
    for (std::uint32_t z = first[2]; z <= last[2]; ++z)
      for (std::uint32_t y = first[1]; y <= last[1]; ++y)
        for (std::uint32_t x = first[0]; x <= last[0]; ++x) {
          const std::uint32_t bit = RegionPage::bit_of(x, y, z), word = bit / 64;
          const std::uint64_t left = page.labelled_[word] << (63 - bit % 64);  // the cell and those before it
          if (left >> 63 == 0) continue;
          const std::uint32_t cell = page.before_[word] + static_cast<std::uint32_t>(std::popcount(left)) - 1;
          if (page.ends_.empty())
            visit_regions(page, cell, cell + 1, centre, squared_radius, visit, tests_left);
          else
            visit_regions(page, cell == 0 ? 0 : page.ends_[cell - 1], page.ends_[cell], centre, squared_radius, visit,
                          tests_left);
        }
  }

  /// Visits the regions of a page from `region` to before `end`, all of one cell of depth 0, within the radius. Skips
  /// all regions in a cell of any depth that the sphere does not intersect.
  template <class Visit>
  void visit_regions(const RegionPage& page, std::uint32_t region, std::uint32_t end, const Vec3d& centre,
                     double squared_radius, Visit& visit, std::uint32_t& tests_left) const noexcept {
    for (; region < end && tests_left > 0; --tests_left) {
      const Cell& cell = page.cells_[region];
      const CellPlace place = cell.place;
      std::uint32_t depth = 0;
      while (depth <= place.depth && box_of(place.around(depth)).squared_distance(centre) <= squared_radius) ++depth;
      if (depth <= place.depth) {
        region = page.end_of(place.around(depth), region, end);
        continue;
      }
      const double squared = squared_distance(cell, centre);
      if (squared <= squared_radius) {
        const RegionId id{page.first_ + region};
        if constexpr (std::is_invocable_v<Visit&, RegionId, double, const CellBox&>)
          visit(id, squared, box_of(place));
        else
          visit(id, squared);
      }
      ++region;
    }
  }

  [[nodiscard]] CellBox box_of(const CellPlace& cell) const noexcept {
    static constexpr double kShare[kMaxCellDepth + 1] = {1,      0x1p-1, 0x1p-2, 0x1p-3, 0x1p-4,
                                                         0x1p-5, 0x1p-6, 0x1p-7, 0x1p-8};
    const double edge = frame_.cell_size * kShare[cell.depth];
    const Vec3d low = Vec3d{frame_.origin[0], frame_.origin[1], frame_.origin[2]} +
                      edge * Vec3d{double(cell.at[0]), double(cell.at[1]), double(cell.at[2])};
    return {low, low + Vec3d::Constant(edge)};
  }
  [[nodiscard]] double squared_distance(const Cell& cell, const Vec3d& p) const noexcept;
  [[nodiscard]] const Cell& cell(RegionId region) const noexcept;
  [[nodiscard]] std::uint32_t first_bucket(PageId page) const noexcept {
    return static_cast<std::uint32_t>((index(page) * multiplier_) >> 32) & mask_;
  }

  GridFrame frame_;
  std::uint32_t regions_;                                 // of the model
  std::uint32_t regions_here_ = 0;                        // in the pages
  std::array<double, 3> extent_{};                        // max cell coordinate at depth 0, by axis
  std::vector<std::unique_ptr<const RegionPage>> owned_;  // the pages, if the grid has made them
  std::vector<const RegionPage*> pages_;                  // in the order of their ids
  std::vector<const RegionPage*> buckets_;                // hash table with open addressing; null: empty
  std::uint64_t multiplier_ = hash_multiplier();
  std::uint32_t mask_ = 0;
};

}  // namespace tactus::spm
