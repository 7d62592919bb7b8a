// Eight at once against one at a time.

#include "spm/lanes.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <vector>

#include "spm/triangle.hpp"

namespace tactus::spm {
namespace {

constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();
using Triangles = std::array<lanes::Floats, lanes::kTriangleRows>;
using Boxes = std::array<lanes::Floats, lanes::kBoxRows>;

Vec3d corner(const Triangles& triangles, std::size_t lane, std::size_t number) {
  return {triangles[3 * number][lane], triangles[3 * number + 1][lane], triangles[3 * number + 2][lane]};
}

/// Random ones, and in some lanes a point, a segment, a needle, or nothing.
Triangles random_triangles(std::mt19937_64& random) {
  std::uniform_real_distribution<float> coordinate{-1, 1};
  Triangles triangles;
  for (std::size_t lane = 0; lane < lanes::kLanes; ++lane) {
    for (lanes::Floats& row : triangles) row[lane] = coordinate(random);
    const std::uint64_t kind = random() % 8;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float a = triangles[axis][lane], b = triangles[3 + axis][lane];
      if (kind == 0 || kind == 1) triangles[6 + axis][lane] = a;                            // segment
      if (kind == 1) triangles[3 + axis][lane] = a;                                         // point
      if (kind == 2) triangles[6 + axis][lane] = a + 0.3f * (b - a) + 1e-6f * float(axis);  // needle
      if (kind == 3)
        for (std::size_t c = 0; c < 3; ++c) triangles[3 * c + axis][lane] = kNothing;
    }
  }
  return triangles;
}

std::vector<Simd> available() {
  std::vector<Simd> all{Simd::kBase};
  if (best_simd() != Simd::kBase) all.push_back(Simd::kAvx2);
  if (best_simd() == Simd::kAvx512) all.push_back(Simd::kAvx512);
  return all;
}

class Lanes : public ::testing::TestWithParam<Simd> {
 protected:
  const lanes::Kernels& kernels_ = lanes::kernels(GetParam());
};

TEST_P(Lanes, ClosestPointsAreThoseOfOneTriangleAtATime) {
  std::mt19937_64 random{1};
  std::uniform_real_distribution<double> coordinate{-2, 2};
  int empty = 0;
  for (int round = 0; round < 5000; ++round) {
    const Triangles triangles = random_triangles(random);
    const Vec3d p{coordinate(random), coordinate(random), coordinate(random)};
    lanes::Closest found;

    kernels_.closest_points(triangles.data(), {p[0], p[1], p[2]}, lanes::kAllLanes, found);
    lanes::Closest base;
    lanes::kernels(Simd::kBase).closest_points(triangles.data(), {p[0], p[1], p[2]}, lanes::kAllLanes, base);
    ASSERT_EQ(std::memcmp(&found.squared_distance, &base.squared_distance, sizeof found.squared_distance), 0);

    for (std::size_t lane = 0; lane < lanes::kLanes; ++lane) {
      if (std::isnan(triangles[0][lane])) {
        ++empty;
        ASSERT_FALSE(found.squared_distance[lane] <= 1e30) << "round " << round << " lane " << lane;
        continue;
      }
      const ClosestPoint expected =
          closest_point(p, corner(triangles, lane, 0), corner(triangles, lane, 1), corner(triangles, lane, 2));
      // Both are right to rounding; they may differ in whether an edge or the face is a rounding nearer.
      ASSERT_NEAR(found.squared_distance[lane], expected.squared_distance, 1e-13) << "round " << round;
      const Vec3d point{found.point[0][lane], found.point[1][lane], found.point[2][lane]};
      ASSERT_NEAR((p - point).squaredNorm(), found.squared_distance[lane], 1e-13) << "round " << round;
    }
  }
  EXPECT_GT(empty, 1000);
}

TEST_P(Lanes, ABallTouchesWhatIsAsNearAsItsRadius) {
  std::mt19937_64 random{6};
  std::uniform_real_distribution<double> coordinate{-2, 2}, size{0, 3};
  int touched = 0;
  for (int round = 0; round < 5000; ++round) {
    const Triangles triangles = random_triangles(random);
    const std::array<double, 3> p{coordinate(random), coordinate(random), coordinate(random)};
    const double radius = size(random);
    const auto wanted = static_cast<unsigned>(random() % (lanes::kAllLanes + 1));
    lanes::Closest closest;
    kernels_.closest_points(triangles.data(), p, wanted, closest);

    lanes::Touches found, base;
    const unsigned bits = kernels_.touches(triangles.data(), p, wanted, radius, found);
    ASSERT_EQ(lanes::kernels(Simd::kBase).touches(triangles.data(), p, wanted, radius, base), bits);

    for (unsigned lane = 0; lane < lanes::kLanes; ++lane) {
      const bool expected = (wanted >> lane & 1u) != 0 && closest.squared_distance[lane] <= radius * radius;
      ASSERT_EQ((bits >> lane & 1u) != 0, expected) << "round " << round << " lane " << lane;
      if (!expected) continue;
      ++touched;
      const double distance = std::sqrt(closest.squared_distance[lane]);
      ASSERT_EQ(found.depth[lane], radius - distance) << "round " << round << " lane " << lane;
      ASSERT_EQ(base.depth[lane], found.depth[lane]) << "round " << round << " lane " << lane;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        ASSERT_EQ(found.point[axis][lane], closest.point[axis][lane]) << "round " << round << " lane " << lane;
        ASSERT_EQ(found.normal[axis][lane], (p[axis] - found.point[axis][lane]) * (1 / distance)) << "round " << round;
        ASSERT_EQ(base.normal[axis][lane], found.normal[axis][lane]) << "round " << round << " lane " << lane;
      }
    }
  }
  EXPECT_GT(touched, 1000);
}

TEST_P(Lanes, OnlyWantedTrianglesNeedBeRight) {
  std::mt19937_64 random{4};
  const Triangles triangles = random_triangles(random);
  lanes::Closest all;
  kernels_.closest_points(triangles.data(), {0.1, 0.2, 0.3}, lanes::kAllLanes, all);
  for (unsigned wanted = 0; wanted <= lanes::kAllLanes; ++wanted) {
    lanes::Closest some;
    kernels_.closest_points(triangles.data(), {0.1, 0.2, 0.3}, wanted, some);
    for (unsigned lane = 0; lane < lanes::kLanes; ++lane) {
      const double full = all.squared_distance[lane], partial = some.squared_distance[lane];
      if ((wanted >> lane & 1u) != 0 && full <= 1e30) {
        ASSERT_EQ(partial, full) << "wanted " << wanted << " lane " << lane;
      } else {
        ASSERT_FALSE(partial < full) << "wanted " << wanted << " lane " << lane;
      }
    }
  }
}

TEST_P(Lanes, TrianglesWithinAreThoseWhoseBoxesAre) {
  std::mt19937_64 random{5};
  std::uniform_real_distribution<float> coordinate{-2, 2};
  int within = 0;
  for (int round = 0; round < 5000; ++round) {
    const Triangles triangles = random_triangles(random);
    const std::array<float, 3> p{coordinate(random), coordinate(random), coordinate(random)};
    Boxes boxes;
    for (std::size_t lane = 0; lane < lanes::kLanes; ++lane)
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float a = triangles[axis][lane], b = triangles[3 + axis][lane], c = triangles[6 + axis][lane];
        const bool none = std::isnan(a);
        boxes[axis][lane] = none ? kNothing : std::min({a, b, c});
        boxes[3 + axis][lane] = none ? kNothing : std::max({a, b, c});
      }

    const unsigned found = kernels_.triangles_within(triangles.data(), p, 0.5f);

    ASSERT_EQ(found, kernels_.boxes_within(boxes.data(), p, 0.5f)) << "round " << round;
    within += found != 0 ? 1 : 0;
  }
  EXPECT_GT(within, 1000);
}

TEST_P(Lanes, BoundsHoldAllCornersAndNoMore) {
  std::mt19937_64 random{2};
  for (int round = 0; round < 5000; ++round) {
    const Triangles triangles = random_triangles(random);

    lanes::Bounds bounds;
    kernels_.bounds_of_triangles(triangles.data(), bounds);

    for (std::size_t axis = 0; axis < 3; ++axis) {
      float low = std::numeric_limits<float>::infinity(), high = -low;
      for (std::size_t c = 0; c < 3; ++c)
        for (const float x : triangles[3 * c + axis]) {
          if (std::isnan(x)) continue;
          low = std::min(low, x);
          high = std::max(high, x);
        }
      ASSERT_EQ(bounds.low[axis], low) << "round " << round;
      ASSERT_EQ(bounds.high[axis], high) << "round " << round;
    }
  }
}

class LaneBoxes : public Lanes {
 protected:
  std::mt19937_64 random_{3};

  Boxes random_boxes() {
    std::uniform_real_distribution<float> coordinate{-1, 1};
    Boxes boxes;
    for (std::size_t lane = 0; lane < lanes::kLanes; ++lane) {
      const bool none = random_() % 4 == 0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float a = coordinate(random_), b = coordinate(random_);
        boxes[axis][lane] = none ? kNothing : std::min(a, b);
        boxes[3 + axis][lane] = none ? kNothing : std::max(a, b);
      }
    }
    return boxes;
  }
  std::array<float, 3> random_point() {
    std::uniform_real_distribution<float> coordinate{-1.5f, 1.5f};
    return {coordinate(random_), coordinate(random_), coordinate(random_)};
  }
};

TEST_P(LaneBoxes, DistancesMeetingsAndBoundsAreThoseOfOneBoxAtATime) {
  for (int round = 0; round < 5000; ++round) {
    const Boxes boxes = random_boxes();
    const std::array<float, 3> p = random_point(), q = random_point();
    std::array<float, 3> low, high;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(p[axis], q[axis]);
      high[axis] = std::max(p[axis], q[axis]);
    }
    const float radius2 = 0.3f;
    unsigned within = 0, meeting = 0;
    lanes::Floats expected{};
    lanes::Bounds all;
    all.low.fill(std::numeric_limits<float>::infinity());
    all.high.fill(-std::numeric_limits<float>::infinity());
    for (std::size_t lane = 0; lane < lanes::kLanes; ++lane) {
      if (std::isnan(boxes[0][lane])) {
        expected[lane] = kNothing;
        continue;
      }
      bool meets = true;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float d = std::max({boxes[axis][lane] - p[axis], p[axis] - boxes[3 + axis][lane], 0.f});
        expected[lane] += d * d;
        meets = meets && boxes[axis][lane] <= high[axis] && boxes[3 + axis][lane] >= low[axis];
        all.low[axis] = std::min(all.low[axis], boxes[axis][lane]);
        all.high[axis] = std::max(all.high[axis], boxes[3 + axis][lane]);
      }
      within |= static_cast<unsigned>(expected[lane] <= radius2) << lane;
      meeting |= static_cast<unsigned>(meets) << lane;
    }

    lanes::Floats squared;
    kernels_.box_distances(boxes.data(), p, squared);
    lanes::Bounds bounds;
    kernels_.bounds_of_boxes(boxes.data(), bounds);

    for (std::size_t lane = 0; lane < lanes::kLanes; ++lane) {
      if (std::isnan(expected[lane])) {
        ASSERT_TRUE(std::isnan(squared[lane])) << "round " << round;
      } else {
        ASSERT_EQ(squared[lane], expected[lane]) << "round " << round;
      }
    }
    ASSERT_EQ(kernels_.boxes_within(boxes.data(), p, radius2), within) << "round " << round;
    ASSERT_EQ(kernels_.boxes_meeting(boxes.data(), low, high), meeting) << "round " << round;
    ASSERT_EQ(bounds.low, all.low) << "round " << round;
    ASSERT_EQ(bounds.high, all.high) << "round " << round;
  }
}

INSTANTIATE_TEST_SUITE_P(InstructionSets, Lanes, ::testing::ValuesIn(available()));
INSTANTIATE_TEST_SUITE_P(InstructionSets, LaneBoxes, ::testing::ValuesIn(available()));

}  // namespace
}  // namespace tactus::spm
