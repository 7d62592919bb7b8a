// Compares the cells that intersect a sphere with a search of all 64 subcells of every cell.

#include "spm/region_grid.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <numeric>
#include <random>
#include <utility>
#include <vector>

#include "tests/support/cells.hpp"

namespace tactus::spm {
namespace {

struct Grid {
  GridFrame frame{{-2.5, 0.5, -1}, 0.25};
  std::vector<Region> regions;
};

/// Random cells of depth 0 in eight pages. One cell is divided into cells of depth 1, and one of these again.
Grid random_grid(std::mt19937_64& random) {
  Grid grid;
  const auto add = [&](std::uint16_t depth, std::uint32_t x, std::uint32_t y, std::uint32_t z) {
    Region region{};
    region.depth = depth;
    region.cell = {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), static_cast<std::uint16_t>(z)};
    while (region.occupied[0] == 0 && region.occupied[1] == 0)
      for (std::uint32_t& word : region.occupied)
        for (std::uint32_t bit = 0; bit < 32; ++bit) word |= static_cast<std::uint32_t>(random() % 8 == 0) << bit;
    grid.regions.push_back(region);
  };
  const auto add_children = [&](std::uint16_t depth, std::uint32_t x, std::uint32_t y, std::uint32_t z,
                                std::uint32_t except) {
    for (std::uint32_t i = 0; i < 8; ++i)
      if (i != except) add(depth, 2 * x + (i & 1), 2 * y + (i >> 1 & 1), 2 * z + (i >> 2));
  };
  for (std::uint32_t x = 6; x < 10; ++x)
    for (std::uint32_t y = 6; y < 10; ++y)
      for (std::uint32_t z = 6; z < 10; ++z) {
        if (x == 7 && y == 8 && z == 7) {
          add_children(1, x, y, z, 5);
          add_children(2, 2 * x + 1, 2 * y, 2 * z + 1, 8);
        } else if (random() % 3 != 0) {
          add(0, x, y, z);
        }
      }
  test_support::sort_cells(grid.regions);
  return grid;
}

double brute_squared_distance(const Grid& grid, const Region& region, const Vec3d& p) {
  const double edge = grid.frame.cell_size / (1 << region.depth);
  double nearest = 1e300;
  for (std::uint32_t bit = 0; bit < 64; ++bit) {
    if ((region.occupied[bit / 32] >> bit % 32 & 1u) == 0) continue;
    const std::uint32_t subcell[3] = {bit & 3, bit >> 2 & 3, bit >> 4};
    double squared = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double low = grid.frame.origin[axis] + region.cell[axis] * edge + subcell[axis] * edge / 4;
      const double distance = std::max({low - p[axis], p[axis] - low - edge / 4, 0.0});
      squared += distance * distance;
    }
    nearest = std::min(nearest, squared);
  }
  return nearest;
}

TEST(RegionGrid, ASphereIntersectsTheCellsWithAnOccupiedSubcellWithinItsRadius) {
  std::mt19937_64 random{5};
  std::uniform_real_distribution<double> unit{0, 1};
  std::uint64_t intersecting = 0, box_only = 0;
  for (int round = 0; round < 300; ++round) {
    const Grid grid = random_grid(random);
    const RegionGrid region_grid{grid.frame, grid.regions};
    const Vec3d centre = Vec3d{-1.2, 1.8, 0.3} + 1.4 * Vec3d{unit(random), unit(random), unit(random)};
    const double radius = 0.4 * unit(random);
    std::vector<std::uint32_t> expected, found;
    for (std::uint32_t i = 0; i < grid.regions.size(); ++i) {
      const double squared = brute_squared_distance(grid, grid.regions[i], centre);
      ASSERT_NEAR(region_grid.squared_distance(RegionId{i}, centre), squared, 1e-12) << "round " << round;
      if (squared <= radius * radius) expected.push_back(i);
      if (squared > radius * radius && region_grid.box(RegionId{i}).squared_distance(centre) <= radius * radius)
        ++box_only;
    }

    const bool complete = region_grid.for_each_intersecting(centre, radius, [&](RegionId region, double squared) {
      EXPECT_LE(squared, radius * radius);
      found.push_back(index(region));
    });

    ASSERT_TRUE(complete);
    std::sort(found.begin(), found.end());
    ASSERT_EQ(found, expected) << "round " << round;
    intersecting += found.size();
  }
  EXPECT_GT(intersecting, 500u);
  EXPECT_GT(box_only, 200u) << "whole cells would give the same result";
}

/// Divides the corner cell of each depth up to 8, so that a query of all cells visits every depth.
Grid nested_grid() {
  Grid grid;
  for (std::uint16_t depth = 1; depth <= 8; ++depth)
    for (std::uint32_t child = depth < 8 ? 1 : 0; child < 8; ++child) {
      Region region{};
      region.depth = depth;
      region.cell = {static_cast<std::uint16_t>(child & 1), static_cast<std::uint16_t>(child >> 1 & 1),
                     static_cast<std::uint16_t>(child >> 2)};
      region.occupied = {~0u, ~0u};
      grid.regions.push_back(region);
    }
  test_support::sort_cells(grid.regions);
  return grid;
}

TEST(RegionGrid, AQueryUsesTheSameStackAtEveryDepth) {
  const Grid grid = nested_grid();
  const RegionGrid region_grid{grid.frame, grid.regions};
  const Vec3d corner{grid.frame.origin[0], grid.frame.origin[1], grid.frame.origin[2]};
  std::vector<const void*> frames;
  std::vector<std::uint32_t> found;
  const auto visit = [&](RegionId region, double) __attribute__((noinline)) {
    frames.push_back(__builtin_frame_address(0));
    found.push_back(index(region));
  };
  ASSERT_TRUE(region_grid.for_each_intersecting(corner, 1.0, visit));
  std::vector<std::uint32_t> expected(grid.regions.size());
  std::iota(expected.begin(), expected.end(), 0u);
  EXPECT_EQ(found, expected);
  for (const void* frame : frames) EXPECT_EQ(frame, frames.front());
}

TEST(RegionGrid, AQueryTestsALimitedNumberOfRegions) {
  Grid grid;
  for (std::uint16_t x = 0; x < 32; ++x)
    for (std::uint16_t y = 0; y < 32; ++y)
      for (std::uint16_t z = 0; z < 32; ++z) {
        Region region{};
        region.depth = 8;
        region.cell = {x, y, z};
        region.occupied = {~0u, ~0u};
        grid.regions.push_back(region);
      }
  test_support::sort_cells(grid.regions);
  const RegionGrid region_grid{grid.frame, grid.regions};
  const Vec3d corner{grid.frame.origin[0], grid.frame.origin[1], grid.frame.origin[2]};
  std::uint32_t visited = 0;
  const auto visit = [&](RegionId, double) { ++visited; };
  EXPECT_FALSE(region_grid.for_each_intersecting(corner, 1.0, visit));
  EXPECT_EQ(visited, RegionGrid::kMaxTests);
  visited = 0;
  EXPECT_TRUE(region_grid.for_each_intersecting(corner, grid.frame.cell_size / 256, visit));
  EXPECT_GT(visited, 1u);
}

/// All pages with these regions.
std::vector<std::unique_ptr<const RegionPage>> pages_of(std::span<const Region> regions) {
  std::vector<std::unique_ptr<const RegionPage>> pages;
  for (std::uint32_t first = 0; first < regions.size();) {
    const std::span<const Region> left = regions.subspan(first);
    const std::size_t count = RegionPage::leading(left);
    pages.push_back(std::make_unique<const RegionPage>(page_of(left[0]), first, left.first(count)));
    first += static_cast<std::uint32_t>(count);
  }
  return pages;
}

ModelSummary summary_of(const Grid& grid) {
  ModelSummary summary{};
  summary.grid = grid.frame;
  summary.regions = static_cast<std::uint32_t>(grid.regions.size());
  summary.bounds_min = {-2.5F, 0.5F, -1};
  summary.bounds_max = {1.5F, 4.5F, 3};
  return summary;
}

TEST(RegionGrid, AGridOfAllPagesFindsTheSameInEveryOrderOfInsertion) {
  std::mt19937_64 random{9};
  std::uniform_real_distribution<double> unit{0, 1};
  const Grid grid = random_grid(random);
  const RegionGrid whole{grid.frame, grid.regions};
  auto pages = pages_of(grid.regions);
  for (int round = 0; round < 20; ++round) {
    std::shuffle(pages.begin(), pages.end(), random);
    RegionGrid inserted{summary_of(grid), static_cast<std::uint32_t>(pages.size())};
    for (const auto& page : pages) {
      ASSERT_TRUE(inserted.can_insert(*page));
      inserted.insert(*page);
      EXPECT_FALSE(inserted.can_insert(*page)) << "a second time";
    }
    for (int query = 0; query < 50; ++query) {
      const Vec3d centre = Vec3d{-1.2, 1.8, 0.3} + 1.4 * Vec3d{unit(random), unit(random), unit(random)};
      const double radius = 0.4 * unit(random);
      std::vector<std::pair<std::uint32_t, double>> expected, found;
      ASSERT_TRUE(whole.for_each_intersecting(
          centre, radius, [&](RegionId region, double squared) { expected.emplace_back(index(region), squared); }));
      ASSERT_TRUE(inserted.for_each_intersecting(
          centre, radius, [&](RegionId region, double squared) { found.emplace_back(index(region), squared); }));
      EXPECT_EQ(found, expected);
    }
  }
}

TEST(RegionGrid, StatesWhetherAPageThatASphereMeetsIsMissing) {
  std::mt19937_64 random{10};
  const Grid grid = random_grid(random);
  const auto pages = pages_of(grid.regions);
  RegionGrid partial{summary_of(grid), static_cast<std::uint32_t>(pages.size())};
  const auto missing_at = [&](const Vec3d& centre, double radius) {
    std::vector<PageId> missing;
    partial.for_each_page(centre, radius, [&](PageId page, const RegionPage* here) {
      if (here == nullptr) missing.push_back(page);
    });
    return missing;
  };
  const Vec3d corner = Vec3d{-2.5, 0.5, -1} + 8 * 0.25 * Vec3d::Ones();  // of all eight pages
  EXPECT_FALSE(partial.has_pages(corner, 0.1));
  EXPECT_EQ(missing_at(corner, 0.1).size(), 8u);
  for (std::size_t i = 0; i < pages.size(); ++i) {
    EXPECT_FALSE(partial.has(RegionId{pages[i]->first_region()}));
    partial.insert(*pages[i]);
    EXPECT_TRUE(partial.has(RegionId{pages[i]->first_region()}));
    EXPECT_EQ(missing_at(corner, 0.1).size(), pages.size() - i - 1);
    EXPECT_EQ(partial.has_pages(corner, 0.1), i + 1 == pages.size());
    const Vec3d inside =
        (partial.box(RegionId{pages[i]->first_region()}).low + partial.box(RegionId{pages[i]->first_region()}).high) /
        2;
    EXPECT_TRUE(partial.has_pages(inside, 0.01)) << "it meets this page only";
  }
}

TEST(RegionGrid, APageWithoutRegionsIsKnownToBeEmpty) {
  Grid grid;
  Region region{};
  region.occupied = {1, 0};
  region.cell = {12, 2, 2};
  grid.regions.push_back(region);
  RegionGrid partial{summary_of(grid), 2};
  const Vec3d beside{-2.4, 0.6, -0.9};
  EXPECT_FALSE(partial.has_pages(beside, 0.01));
  const RegionPage empty{page_at(0, 0, 0), 0, {}};
  ASSERT_TRUE(partial.can_insert(empty));
  partial.insert(empty);
  EXPECT_TRUE(partial.has_pages(beside, 0.01));
  EXPECT_FALSE(partial.has(RegionId{0}));
  const RegionPage page{page_of(region), 0, grid.regions};
  ASSERT_TRUE(partial.can_insert(page));
  partial.insert(page);
  EXPECT_TRUE(partial.has(RegionId{0}));
}

TEST(RegionGrid, APageThatContradictsAnotherOneIsRefused) {
  std::mt19937_64 random{11};
  const Grid grid = random_grid(random);
  const auto pages = pages_of(grid.regions);
  RegionGrid partial{summary_of(grid), static_cast<std::uint32_t>(pages.size())};
  partial.insert(*pages[1]);
  const auto page = [&](PageId id, std::uint32_t first) {
    return RegionPage{id, first, std::span<const Region>{grid.regions}.first(1)};
  };
  EXPECT_FALSE(partial.can_insert(page(pages[0]->id(), pages[1]->first_region()))) << "a region of a later page";
  EXPECT_FALSE(partial.can_insert(page(pages[2]->id(), pages[1]->end_region() - 1))) << "a region of an earlier page";
  EXPECT_FALSE(partial.can_insert(page(pages[7]->id(), static_cast<std::uint32_t>(grid.regions.size()))));
  EXPECT_TRUE(partial.can_insert(*pages[0]));
  EXPECT_TRUE(partial.can_insert(*pages[2]));
}

TEST(RegionGrid, FindsTheOtherPagesAfterSomeAreRemoved) {
  std::mt19937_64 random{13};
  std::vector<Region> regions;
  for (std::uint16_t x = 0; x < 128; ++x)
    for (std::uint16_t y = 0; y < 128; y = static_cast<std::uint16_t>(y + 8)) {
      Region region{};
      region.cell = {x, y, 0};
      region.occupied = {1, 0};
      regions.push_back(region);
    }
  test_support::sort_cells(regions);
  Grid grid;
  grid.regions = regions;
  const auto pages = pages_of(regions);
  ASSERT_EQ(pages.size(), 256u);
  RegionGrid partial{summary_of(grid), 256};
  std::vector<bool> inside(pages.size(), false);
  for (int step = 0; step < 20'000; ++step) {
    const std::size_t i = random() % pages.size();
    inside[i] = !inside[i];
    if (inside[i]) {
      ASSERT_TRUE(partial.can_insert(*pages[i])) << step;
      partial.insert(*pages[i]);
    } else {
      partial.remove(*pages[i]);
    }
    const std::size_t other = random() % pages.size();
    ASSERT_EQ(partial.find(pages[other]->id()), inside[other] ? pages[other].get() : nullptr) << step;
    ASSERT_EQ(partial.has(RegionId{pages[other]->first_region()}), inside[other]) << step;
  }
}

TEST(RegionGrid, HasNoRoomForMorePagesThanItsMaximum) {
  std::mt19937_64 random{12};
  const Grid grid = random_grid(random);
  const auto pages = pages_of(grid.regions);
  RegionGrid partial{summary_of(grid), 2};
  partial.insert(*pages[3]);
  partial.insert(*pages[5]);
  EXPECT_FALSE(partial.can_insert(*pages[4]));
}

TEST(RegionGrid, RefusesASphereWithANaNOrANegativeRadius) {
  std::mt19937_64 random{6};
  const Grid grid = random_grid(random);
  const RegionGrid region_grid{grid.frame, grid.regions};
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  int visited = 0;
  const auto visit = [&](RegionId, double) { ++visited; };
  const Vec3d inside{-0.5, 2.5, 1.0}, outside{100, 0, 0};
  for (const Vec3d& position : {inside, outside})
    for (int axis = 0; axis < 3; ++axis) {
      Vec3d centre = position;
      centre[axis] = kNaN;
      EXPECT_FALSE(region_grid.for_each_intersecting(centre, 0.1, visit)) << axis;
    }
  EXPECT_FALSE(region_grid.for_each_intersecting(inside, kNaN, visit));
  EXPECT_FALSE(region_grid.for_each_intersecting(inside, -0.1, visit));
  EXPECT_EQ(visited, 0);
  EXPECT_TRUE(region_grid.for_each_intersecting(outside, 0.1, visit)) << "a valid sphere that intersects no cell";
}

}  // namespace
}  // namespace tactus::spm
