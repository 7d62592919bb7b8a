// Compares the cells that intersect a sphere with a search of all 64 subcells of every cell.

#include "spm/region_grid.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>
#include <random>
#include <set>
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

TEST(RegionGrid, StatesItsBytes) {
  std::mt19937_64 random{7};
  const Grid grid = random_grid(random);
  // The page of the divided cell stores the ends of its cells.
  std::set<std::array<int, 3>> cells;
  for (const Region& region : grid.regions) {
    const std::array<int, 3> at{region.cell[0] >> region.depth, region.cell[1] >> region.depth,
                                region.cell[2] >> region.depth};
    if (at[0] < 8 && at[1] >= 8 && at[2] < 8) cells.insert(at);
  }
  constexpr std::uint64_t kPages = 8, kBuckets = 16;
  EXPECT_EQ(RegionGrid::bytes(std::span<const Region>{grid.regions}),
            16 * grid.regions.size() + 96 * kPages + 4 * kBuckets + 4 * cells.size());
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
