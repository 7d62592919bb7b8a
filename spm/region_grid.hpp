/// Finds the regions that a sphere intersects.
///
/// The grid stores the labelled cells by page. A page is a cube of 8 x 8 x 8 cells of depth 0 with a bit for each of
/// them. Regions are in Morton order, so those of a page and those of a cell are consecutive. A sphere intersects a
/// region if it intersects an occupied subcell (Region::occupied) of its cell. A test of whole cells would select a
/// third more regions.
///
/// Model frame, file units. Queries are O(cells in the bounds of the sphere). Realtime after construction.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <span>
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

class RegionGrid {
 public:
  /// Allocates. `regions` must have passed violations().
  RegionGrid(const GridFrame& frame, std::span<const Region> regions);

  [[nodiscard]] std::uint32_t size() const noexcept { return static_cast<std::uint32_t>(cells_.size()); }
  [[nodiscard]] CellBox box(RegionId region) const noexcept { return box_of(cells_[index(region)].place); }
  /// Estimates the bytes of a grid. Assumes 40 regions in a page, and that a quarter of the regions is in pages with
  /// divided cells.
  [[nodiscard]] static std::uint64_t bytes(std::uint32_t regions) noexcept;
  /// Returns the bytes of the grid of these regions.
  [[nodiscard]] static std::uint64_t bytes(std::span<const Region> regions) noexcept;

  /// The squared distance of `p` from the nearest occupied subcell; 0 inside. About 20 ns.
  [[nodiscard]] double squared_distance(RegionId region, const Vec3d& p) const noexcept;

  /// Calls `visit(RegionId, squared distance)` once for each region within `radius` of `centre`, in a fixed order. If
  /// the bounds of the sphere contain more than `kMaxCells` cells of depth 0, a coordinate is not finite, or the radius
  /// is NaN or negative, returns false and visits nothing. Also returns false after `kMaxTests` tests of regions; then
  /// `visit` was called for some of them only.
  template <class Visit>
  bool for_each_intersecting(const Vec3d& centre, double radius, Visit&& visit) const noexcept {
    if (!centre.allFinite() || !(radius >= 0)) return false;
    std::array<std::uint32_t, 3> low, high;
    std::uint64_t cells = 1;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double at = centre[static_cast<int>(axis)] - frame_.origin[axis];
      const double first = std::floor((at - radius) / frame_.cell_size - kSlack);
      const double last = std::floor((at + radius) / frame_.cell_size + kSlack);
      if (!(last >= 0 && first <= extent_[axis])) return true;
      low[axis] = static_cast<std::uint32_t>(std::max(first, 0.0));
      high[axis] = static_cast<std::uint32_t>(std::min<double>(last, extent_[axis]));
      cells *= high[axis] - low[axis] + 1;
    }
    if (cells > kMaxCells) return false;
    std::uint32_t tests_left = kMaxTests;
    for (std::uint32_t z = low[2] / kPageSide; z <= high[2] / kPageSide; ++z)
      for (std::uint32_t y = low[1] / kPageSide; y <= high[1] / kPageSide; ++y)
        for (std::uint32_t x = low[0] / kPageSide; x <= high[0] / kPageSide; ++x)
          if (const Page* page = find({x, y, z}))
            visit_page(*page, {x, y, z}, low, high, centre, radius * radius, visit, tests_left);
    return tests_left > 0;
  }
  static constexpr std::uint64_t kMaxCells = 4096;
  static constexpr std::uint32_t kMaxTests = 8192;

 private:
  static constexpr std::uint32_t kPageSide = 8;
  // The bounds of a sphere grow by this share of a cell, so that rounding hides no cell that the sphere touches.
  static constexpr double kSlack = 1e-9;

  using Coordinates = std::array<std::uint32_t, 3>;
  /// A cell of any depth.
  struct Place {
    std::array<std::uint16_t, 3> at;  // x, y, z at its depth
    std::uint16_t depth;

    /// The cell of the given smaller depth around this one.
    [[nodiscard]] Place around(std::uint32_t smaller) const noexcept {
      const std::uint32_t up = depth - smaller;
      return {{static_cast<std::uint16_t>(at[0] >> up), static_cast<std::uint16_t>(at[1] >> up),
               static_cast<std::uint16_t>(at[2] >> up)},
              static_cast<std::uint16_t>(smaller)};
    }
    [[nodiscard]] bool operator==(const Place&) const noexcept = default;
  };
  struct Cell {
    Place place;
    std::uint64_t occupied;  // bits as in Region::occupied
  };
  struct Page {
    static constexpr std::uint32_t kWords = kPageSide * kPageSide * kPageSide / 64;
    std::uint64_t key;
    std::uint32_t first_region;
    std::uint32_t ends = kNone;  // if a cell is divided: index in ends_ of the page's first labelled cell
    std::array<std::uint16_t, kWords> before{};    // number of labelled cells in the words before this one
    std::array<std::uint64_t, kWords> labelled{};  // a bit for each cell of depth 0, in Morton order
  };

  /// Visits the regions of a page in the cells from `low` to `high`.
  template <class Visit>
  void visit_page(const Page& page, const Coordinates& at, const Coordinates& low, const Coordinates& high,
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
          const std::uint32_t bit = bit_of(x, y, z), word = bit / 64;
          const std::uint64_t left = page.labelled[word] << (63 - bit % 64);  // the cell and those before it
          if (left >> 63 == 0) continue;
          const std::uint32_t cell = page.before[word] + static_cast<std::uint32_t>(std::popcount(left)) - 1;
          if (page.ends == kNone) {
            visit_regions(page.first_region + cell, page.first_region + cell + 1, centre, squared_radius, visit,
                          tests_left);
          } else {
            const std::uint32_t begin = cell == 0 ? page.first_region : ends_[page.ends + cell - 1];
            visit_regions(begin, ends_[page.ends + cell], centre, squared_radius, visit, tests_left);
          }
        }
  }

  /// Visits the regions from `region` to before `end`, all of one cell of depth 0, within the radius. Skips all regions
  /// in a cell of any depth that the sphere does not intersect.
  template <class Visit>
  void visit_regions(std::uint32_t region, std::uint32_t end, const Vec3d& centre, double squared_radius, Visit& visit,
                     std::uint32_t& tests_left) const noexcept {
    for (; region < end && tests_left > 0; --tests_left) {
      const Place place = cells_[region].place;
      std::uint32_t depth = 0;
      while (depth <= place.depth && box_of(place.around(depth)).squared_distance(centre) <= squared_radius) ++depth;
      if (depth <= place.depth) {
        region = end_of(place.around(depth), region, end);
        continue;
      }
      const double squared = squared_distance(RegionId{region}, centre);
      if (squared <= squared_radius) visit(RegionId{region}, squared);
      ++region;
    }
  }
  /// Returns the first region after those in the cell. `first` is in the cell; all regions to before `end` are in the
  /// same cell of depth 0.
  [[nodiscard]] std::uint32_t end_of(const Place& cell, std::uint32_t first, std::uint32_t end) const noexcept {
    const auto is_inside = [&cell](const Cell& region) {
      return region.place.depth >= cell.depth && region.place.around(cell.depth) == cell;
    };
    const auto at = cells_.begin();
    return static_cast<std::uint32_t>(std::partition_point(at + first, at + end, is_inside) - at);
  }

  [[nodiscard]] CellBox box_of(const Place& cell) const noexcept {
    static constexpr double kShare[kMaxCellDepth + 1] = {1,      0x1p-1, 0x1p-2, 0x1p-3, 0x1p-4,
                                                         0x1p-5, 0x1p-6, 0x1p-7, 0x1p-8};
    const double edge = frame_.cell_size * kShare[cell.depth];
    const Vec3d low = Vec3d{frame_.origin[0], frame_.origin[1], frame_.origin[2]} +
                      edge * Vec3d{double(cell.at[0]), double(cell.at[1]), double(cell.at[2])};
    return {low, low + Vec3d::Constant(edge)};
  }
  /// The Morton code of a cell in its page.
  [[nodiscard]] static std::uint32_t bit_of(std::uint32_t x, std::uint32_t y, std::uint32_t z) noexcept {
    static constexpr std::array<std::uint32_t, kPageSide> kSpread{0, 1, 8, 9, 64, 65, 72, 73};
    return kSpread[x] | kSpread[y] << 1 | kSpread[z] << 2;
  }
  /// The key of the page that contains a cell.
  [[nodiscard]] static std::uint64_t key_of(const Place& cell) noexcept {
    const Place at = cell.around(0);
    return key_of(Coordinates{at.at[0] / kPageSide, at.at[1] / kPageSide, at.at[2] / kPageSide});
  }
  [[nodiscard]] static std::uint64_t key_of(const Coordinates& page) noexcept {
    return std::uint64_t{page[0]} | std::uint64_t{page[1]} << 16 | std::uint64_t{page[2]} << 32;
  }
  [[nodiscard]] std::uint32_t first_bucket(std::uint64_t key) const noexcept {
    return static_cast<std::uint32_t>((key * multiplier_) >> 32) & mask_;
  }
  /// Returns null if no cell of the page is labelled.
  [[nodiscard]] const Page* find(const Coordinates& page) const noexcept {
    const std::uint64_t key = key_of(page);
    for (std::uint32_t bucket = first_bucket(key);; bucket = (bucket + 1) & mask_) {
      if (buckets_[bucket] == kNone) return nullptr;
      if (pages_[buckets_[bucket]].key == key) return &pages_[buckets_[bucket]];
    }
  }
  void add_page(std::uint64_t key, std::uint32_t first_region, std::uint32_t end_region);

  GridFrame frame_;
  std::array<double, 3> extent_{};   // max cell coordinate at depth 0, by axis
  std::vector<Cell> cells_;          // by RegionId
  std::vector<Page> pages_;          // in Morton order
  std::vector<std::uint32_t> ends_;  // by labelled cell of depth 0 of the pages with divided cells: its last region + 1
  std::vector<std::uint32_t> buckets_;  // hash table with open addressing: indices in pages_, or kNone
  std::uint64_t multiplier_ = hash_multiplier();
  std::uint32_t mask_ = 0;
};

}  // namespace tactus::spm
