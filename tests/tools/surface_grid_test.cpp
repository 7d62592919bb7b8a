#include "tools/surface_grid.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "spm/triangle.hpp"

namespace tactus::tools {
namespace {

constexpr std::uint64_t kSeed = 20050613;

Point minus(const Point& a, const Point& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
double length(const Point& a) { return std::sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

/// A random triangle in a cube of half edge `size` around `centre`.
Corners random_triangle(std::mt19937_64& random, double size, const Point& centre) {
  std::uniform_real_distribution<double> in_cube{-size, size};
  Corners corners;
  for (int i = 0; i < 9; ++i) corners[i] = static_cast<float>(centre[i % 3] + in_cube(random));
  return corners;
}

Point random_point(std::mt19937_64& random, double size) {
  std::uniform_real_distribution<double> in_cube{-size, size};
  return {in_cube(random), in_cube(random), in_cube(random)};
}

/// The smallest distance from `point` to the points of a lattice on the triangle.
double sampled_distance(const Point& point, const Corners& t, int steps) {
  double smallest = std::numeric_limits<double>::infinity();
  for (int i = 0; i <= steps; ++i)
    for (int j = 0; i + j <= steps; ++j) {
      const double u = static_cast<double>(i) / steps, v = static_cast<double>(j) / steps;
      Point sample;
      for (int axis = 0; axis < 3; ++axis) sample[axis] = (1 - u - v) * t[axis] + u * t[3 + axis] + v * t[6 + axis];
      smallest = std::min(smallest, length(minus(point, sample)));
    }
  return smallest;
}

double longest_edge(const Corners& t) {
  const Point a{t[0], t[1], t[2]}, b{t[3], t[4], t[5]}, c{t[6], t[7], t[8]};
  return std::max({length(minus(a, b)), length(minus(b, c)), length(minus(c, a))});
}

TEST(DistanceToTriangle, IsExactAboveTheFaceAtEdgesAndAtCorners) {
  const Corners t{0, 0, 0, 4, 0, 0, 0, 4, 0};
  EXPECT_DOUBLE_EQ(distance_to_triangle({1, 1, 3}, t), 3);
  EXPECT_DOUBLE_EQ(distance_to_triangle({1, 1, 0}, t), 0);
  EXPECT_DOUBLE_EQ(distance_to_triangle({2, -3, 4}, t), 5);
  EXPECT_DOUBLE_EQ(distance_to_triangle({-2, -1, 2}, t), 3);
  EXPECT_DOUBLE_EQ(distance_to_triangle({4, 4, 0}, t), std::sqrt(8));
  EXPECT_DOUBLE_EQ(distance_to_triangle({7, -4, 0}, t), 5);
}

TEST(DistanceToTriangle, TreatsDegenerateTrianglesAsSegmentsAndPoints) {
  EXPECT_DOUBLE_EQ(distance_to_triangle({1, 2, 0}, {0, 0, 0, 1, 0, 0, 4, 0, 0}), 2);
  EXPECT_DOUBLE_EQ(distance_to_triangle({7, 4, 0}, {0, 0, 0, 1, 0, 0, 4, 0, 0}), 5);
  EXPECT_DOUBLE_EQ(distance_to_triangle({4, 5, 1}, {1, 1, 1, 1, 1, 1, 1, 1, 1}), 5);
}

TEST(DistanceToTriangle, IsWithinTheBoundsThatALatticeOfPointsGives) {
  std::mt19937_64 random{kSeed};
  constexpr int kSteps = 40;
  for (int i = 0; i < 500; ++i) {
    const Corners t = random_triangle(random, 1, {});
    const Point p = random_point(random, 2);
    const double distance = distance_to_triangle(p, t), sampled = sampled_distance(p, t, kSteps);
    ASSERT_LE(distance, sampled + 1e-12) << "seed " << kSeed << " triangle " << i;
    ASSERT_GE(distance, sampled - longest_edge(t) / kSteps) << "seed " << kSeed << " triangle " << i;
  }
}

TEST(DistanceToTriangle, AgreesWithTheClosestPointOfTheHrtcOnThinAndSmallTriangles) {
  std::mt19937_64 random{kSeed};
  for (int i = 0; i < 20000; ++i) {
    Corners t = random_triangle(random, i % 3 == 0 ? 1e-4 : 1, {1, 2, 3});
    if (i % 2 == 0)  // the third corner is almost on the opposite edge
      for (int axis = 0; axis < 3; ++axis) t[6 + axis] = t[axis] + 0.3f * (t[3 + axis] - t[axis]);
    const Point p = random_point(random, 4);
    const auto corner = [&](int c) { return spm::Vec3d{t[3 * c], t[3 * c + 1], t[3 * c + 2]}; };
    const double expected =
        std::sqrt(spm::closest_point({p[0], p[1], p[2]}, corner(0), corner(1), corner(2)).squared_distance);
    ASSERT_NEAR(distance_to_triangle(p, t), expected, 1e-12) << "seed " << kSeed << " triangle " << i;
  }
}

TEST(SurfaceGrid, AgreesWithATestOfAllPairs) {
  std::mt19937_64 random{kSeed};
  std::vector<Corners> triangles;
  for (int i = 0; i < 4000; ++i) {
    const double size = i % 400 == 0 ? 1 : i % 20 == 0 ? 0.1 : 0.01;
    triangles.push_back(random_triangle(random, size, random_point(random, 1)));
  }
  const SurfaceGrid grid{triangles, 0.05};
  std::vector<SurfaceGrid::Near> found;
  std::uniform_real_distribution<double> any_distance{0, 0.2};
  std::size_t total = 0;
  for (int i = 0; i < 400; ++i) {
    const Point p = random_point(random, i % 5 == 0 ? 3 : 1);
    const double distance = any_distance(random);
    std::vector<std::uint32_t> expected, numbers;
    for (std::uint32_t t = 0; t < triangles.size(); ++t)
      if (distance_to_triangle(p, triangles[t]) <= distance) expected.push_back(t);
    grid.within(p, distance, found);
    for (const SurfaceGrid::Near& near : found) {
      numbers.push_back(near.triangle);
      ASSERT_EQ(near.distance, distance_to_triangle(p, triangles[near.triangle]));
    }
    ASSERT_EQ(numbers, expected) << "seed " << kSeed << " point " << i;
    ASSERT_EQ(grid.touches(p, distance), !expected.empty()) << "seed " << kSeed << " point " << i;
    total += expected.size();
  }
  EXPECT_GT(total, 1000u);
}

TEST(SurfaceGrid, FindsNothingFarFromTheSurfaceOrInAnEmptyMesh) {
  const std::vector<Corners> none, one{{0, 0, 0, 1, 0, 0, 0, 1, 0}};
  std::vector<SurfaceGrid::Near> found;
  SurfaceGrid{none, 1}.within({0, 0, 0}, 1, found);
  EXPECT_TRUE(found.empty());
  SurfaceGrid{one, 1e-9}.within({1e300, -1e300, 0}, 1, found);
  EXPECT_TRUE(found.empty());
}

}  // namespace
}  // namespace tactus::tools
