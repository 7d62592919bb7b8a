// Compares the kernels, which compute for eight triangles or boxes at once, with computations for one at a time.

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

constexpr float kEmptyLane = std::numeric_limits<float>::quiet_NaN();
using Triangles = std::array<lanes::Floats, lanes::kTriangleRows>;
using Boxes = std::array<lanes::Floats, lanes::kBoxRows>;

Vec3d corner(const Triangles& triangles, std::size_t lane, std::size_t number) {
  return {triangles[3 * number][lane], triangles[3 * number + 1][lane], triangles[3 * number + 2][lane]};
}

/// Random triangles. Some lanes contain a point, a segment, a needle or no triangle.
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
        for (std::size_t c = 0; c < 3; ++c) triangles[3 * c + axis][lane] = kEmptyLane;
    }
  }
  return triangles;
}

Boxes boxes_of(const Triangles& triangles) {
  Boxes boxes;
  for (std::size_t lane = 0; lane < lanes::kLanes; ++lane)
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float a = triangles[axis][lane], b = triangles[3 + axis][lane], c = triangles[6 + axis][lane];
      const bool none = std::isnan(a);
      boxes[axis][lane] = none ? kEmptyLane : std::min({a, b, c});
      boxes[3 + axis][lane] = none ? kEmptyLane : std::max({a, b, c});
    }
  return boxes;
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

TEST_P(Lanes, ClosestPointsAgreeWithThoseOfSingleTriangles) {
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
      // The two points may differ: by rounding, one computation can find an edge nearest and the other the face.
      ASSERT_NEAR(found.squared_distance[lane], expected.squared_distance, 1e-13) << "round " << round;
      const Vec3d point{found.point[0][lane], found.point[1][lane], found.point[2][lane]};
      ASSERT_NEAR((p - point).squaredNorm(), found.squared_distance[lane], 1e-13) << "round " << round;
    }
  }
  EXPECT_GT(empty, 1000);
}

TEST_P(Lanes, ASphereTouchesTheTrianglesWithinItsRadius) {
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

    const lanes::Faces faces{triangles.data(), FaceId{0x12345678u}, NodeIndex{0x7ffffffe}, 0xa5};
    std::array<Contact, lanes::kLanes> found, base;
    const std::uint32_t count = kernels_.touches(faces, p, wanted, radius, found.data());
    ASSERT_EQ(lanes::kernels(Simd::kBase).touches(faces, p, wanted, radius, base.data()), count);

    std::uint32_t number = 0;
    for (unsigned lane = 0; lane < lanes::kLanes; ++lane) {
      const bool expected = (wanted >> lane & 1u) != 0 && closest.squared_distance[lane] <= radius * radius;
      if (!expected) continue;
      ASSERT_LT(number, count) << "round " << round << " lane " << lane;
      ++touched;
      const Contact& contact = found[number];
      ASSERT_EQ(std::memcmp(&contact, &base[number], sizeof contact), 0) << "round " << round << " lane " << lane;
      ++number;
      ASSERT_EQ(index(contact.face), index(faces.first) + lane);
      ASSERT_EQ(contact.node(), faces.node);
      ASSERT_EQ(contact.is_finest(), (0xa5u >> lane & 1u) != 0);
      for (int axis = 0; axis < 3; ++axis)
        ASSERT_EQ(contact.point[axis], closest.point[axis][lane]) << "round " << round << " lane " << lane;
    }
    ASSERT_EQ(number, count) << "round " << round;
  }
  EXPECT_GT(touched, 1000);
}

// Far from a small triangle, the barycentric coordinates of the closest point are small differences of large products,
// so rounding can spoil them.
TEST_P(Lanes, ClosestPointsAreAccurateFarFromSmallTriangles) {
  std::mt19937_64 random{9};
  std::uniform_real_distribution<double> coordinate{-2, 2};
  for (int round = 0; round < 5000; ++round) {
    Triangles triangles = random_triangles(random);
    const float size = std::pow(10.f, -static_cast<float>(random() % 6));
    for (lanes::Floats& row : triangles)
      for (float& value : row) value *= size;
    const Vec3d p{coordinate(random), coordinate(random), coordinate(random)};
    lanes::Closest found;

    kernels_.closest_points(triangles.data(), {p[0], p[1], p[2]}, lanes::kAllLanes, found);

    for (std::size_t lane = 0; lane < lanes::kLanes; ++lane) {
      if (std::isnan(triangles[0][lane])) continue;
      const Vec3d a = corner(triangles, lane, 0), b = corner(triangles, lane, 1), c = corner(triangles, lane, 2);
      const ClosestPoint expected = closest_point(p, a, b, c);
      ASSERT_NEAR(found.squared_distance[lane], expected.squared_distance, 1e-14 * p.squaredNorm()) << round;
      const Vec3d point{found.point[0][lane], found.point[1][lane], found.point[2][lane]};
      const double longest = std::max({(b - a).norm(), (c - b).norm(), (a - c).norm()});
      // The point is a weighted sum of the corners. The tolerance is the bound that the kernel states for its rounding.
      ASSERT_LE(closest_point(point, a, b, c).squared_distance, 1e-18 * longest * longest + 1e-32) << round;
    }
  }
}

TEST_P(Lanes, ATriangleOutsideTheMaskNeverGetsASmallerDistance) {
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

TEST_P(Lanes, ATriangleIsSelectedByDistanceExactlyWhenItsBoxIs) {
  std::mt19937_64 random{5};
  std::uniform_real_distribution<float> coordinate{-2, 2};
  int within = 0;
  for (int round = 0; round < 5000; ++round) {
    const Triangles triangles = random_triangles(random);
    const std::array<float, 3> p{coordinate(random), coordinate(random), coordinate(random)};

    const unsigned found = kernels_.triangles_within(triangles.data(), p, 0.5f);

    ASSERT_EQ(found, kernels_.boxes_within(boxes_of(triangles).data(), p, 0.5f)) << "round " << round;
    within += found != 0 ? 1 : 0;
  }
  EXPECT_GT(within, 1000);
}

TEST_P(Lanes, TheBoundsOfTrianglesFitTheirCornersExactly) {
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
        boxes[axis][lane] = none ? kEmptyLane : std::min(a, b);
        boxes[3 + axis][lane] = none ? kEmptyLane : std::max(a, b);
      }
    }
    return boxes;
  }
  std::array<float, 3> random_point() {
    std::uniform_real_distribution<float> coordinate{-1.5f, 1.5f};
    return {coordinate(random_), coordinate(random_), coordinate(random_)};
  }
};

TEST_P(Lanes, ATriangleIsSelectedByPathExactlyWhenItsBoxIs) {
  std::mt19937_64 random{6};
  std::uniform_real_distribution<float> coordinate{-1, 1};
  const auto point = [&] { return std::array<float, 3>{coordinate(random), coordinate(random), coordinate(random)}; };
  int on_path = 0;
  for (int round = 0; round < 5000; ++round) {
    const Triangles triangles = random_triangles(random);
    const lanes::SweepBounds path{point(), 1.f, {-0.8f, -0.8f, -0.8f}, {0.5f, 0.5f, 0.5f}, point(), coordinate(random)};

    const unsigned found = kernels_.triangles_on_path(triangles.data(), path);

    ASSERT_EQ(found, kernels_.boxes_on_path(boxes_of(triangles).data(), path)) << "round " << round;
    on_path += found != 0 ? 1 : 0;
  }
  EXPECT_GT(on_path, 1000);
}

TEST_P(Lanes, SweepCandidatesIncludeEveryTriangleThatTheSphereTouchesBeforeTheTimeLimit) {
  std::mt19937_64 random{7};
  std::uniform_real_distribution<double> coordinate{-1.5, 1.5}, share{0, 1};
  int touched = 0, candidates = 0;
  for (int round = 0; round < 20000; ++round) {
    const Triangles triangles = random_triangles(random);
    const Vec3d from{coordinate(random), coordinate(random), coordinate(random)};
    const double scale = round % 2 == 0 ? 1 : 0.01;
    const Vec3d motion = scale * Vec3d{coordinate(random), coordinate(random), coordinate(random)};
    double radius = 0.5 * share(random);
    // In every third round the sphere already touches a triangle at the start, as a proxy does that rests on a surface.
    if (const std::size_t lane = random() % lanes::kLanes; round % 3 == 0 && !std::isnan(triangles[0][lane]))
      radius = (1 - 1e-6) * std::sqrt(closest_point(from, corner(triangles, lane, 0), corner(triangles, lane, 1),
                                                    corner(triangles, lane, 2))
                                          .squared_distance);
    const lanes::Sweep sweep{{from[0], from[1], from[2]}, {motion[0], motion[1], motion[2]}, radius, motion.norm(), 3};
    const double limit = round % 5 == 0 ? share(random) : 1;

    lanes::Doubles earliest;
    const unsigned found = kernels_.sweep_candidates(triangles.data(), sweep, lanes::kAllLanes, limit, earliest);

    for (std::size_t lane = 0; lane < lanes::kLanes; ++lane) {
      const bool is_candidate = (found >> lane & 1u) != 0;
      candidates += is_candidate ? 1 : 0;
      SweepHit hit;
      if (std::isnan(triangles[0][lane])) {
        ASSERT_FALSE(is_candidate) << "round " << round;
      } else if (swept_sphere(from, from + motion, radius, corner(triangles, lane, 0), corner(triangles, lane, 1),
                              corner(triangles, lane, 2), hit) &&
                 hit.time <= limit) {
        ++touched;
        ASSERT_TRUE(is_candidate) << "round " << round << " lane " << lane << " hit time " << hit.time;
        ASSERT_LE(earliest[lane], hit.time) << "round " << round << " lane " << lane;
      }
    }
  }
  EXPECT_GT(touched, 5000);
  EXPECT_LT(candidates, touched * 3 / 2) << "at least a third of the candidates are not touched";
}

TEST_P(LaneBoxes, DistancesPathTestsAndBoundsAgreeWithComputationsPerBox) {
  for (int round = 0; round < 5000; ++round) {
    const Boxes boxes = random_boxes();
    const std::array<float, 3> p = random_point(), q = random_point();
    std::array<float, 3> low, high;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(p[axis], q[axis]);
      high[axis] = std::max(p[axis], q[axis]);
    }
    const float squared_radius = 0.3f;
    const std::array<float, 3> direction = random_point();
    const float behind = 0.5f * random_point()[0];
    unsigned within = 0, on_path = 0;
    lanes::Floats expected{};
    lanes::Bounds all;
    all.low.fill(std::numeric_limits<float>::infinity());
    all.high.fill(-std::numeric_limits<float>::infinity());
    for (std::size_t lane = 0; lane < lanes::kLanes; ++lane) {
      if (std::isnan(boxes[0][lane])) {
        expected[lane] = kEmptyLane;
        continue;
      }
      bool overlaps = true;
      float ahead = 0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const float d = std::max({boxes[axis][lane] - p[axis], p[axis] - boxes[3 + axis][lane], 0.f});
        expected[lane] += d * d;
        overlaps = overlaps && boxes[axis][lane] <= high[axis] && boxes[3 + axis][lane] >= low[axis];
        ahead += std::max(boxes[axis][lane] * direction[axis], boxes[3 + axis][lane] * direction[axis]);
        all.low[axis] = std::min(all.low[axis], boxes[axis][lane]);
        all.high[axis] = std::max(all.high[axis], boxes[3 + axis][lane]);
      }
      const bool is_within = expected[lane] <= squared_radius;
      within |= static_cast<unsigned>(is_within) << lane;
      on_path |= static_cast<unsigned>(overlaps && is_within && ahead >= behind) << lane;
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
    ASSERT_EQ(kernels_.boxes_within(boxes.data(), p, squared_radius), within) << "round " << round;
    const lanes::SweepBounds path{p, squared_radius, low, high, direction, behind};
    ASSERT_EQ(kernels_.boxes_on_path(boxes.data(), path), on_path) << "round " << round;
    ASSERT_EQ(bounds.low, all.low) << "round " << round;
    ASSERT_EQ(bounds.high, all.high) << "round " << round;
  }
}

INSTANTIATE_TEST_SUITE_P(InstructionSets, Lanes, ::testing::ValuesIn(available()));
INSTANTIATE_TEST_SUITE_P(InstructionSets, LaneBoxes, ::testing::ValuesIn(available()));

}  // namespace
}  // namespace tactus::spm
