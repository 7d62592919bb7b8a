// Compares the intersection of two triangles with a separating-axis test in integers. Tests the depth by displacements
// of the probe.

#include "spm/triangle_pair.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cstring>
#include <random>

#include "spm/orientation.hpp"

namespace tactus::spm {
namespace {

using Integers = Eigen::Matrix<std::int64_t, 3, 1>;
using IntegerTriangle = std::array<Integers, 3>;

Triangle3d as_double(const IntegerTriangle& t, double unit = 1) {
  Triangle3d out;
  for (int i = 0; i < 3; ++i) out[i] = t[i].cast<double>() * unit;
  return out;
}

Integers opposite(const IntegerTriangle& t) { return Integers{t[1] - t[0]}.cross(Integers{t[2] - t[0]}); }

/// The separating-axis test: true if no axis separates the triangles strictly. False if a triangle has no area.
bool no_axis_separates(const IntegerTriangle& a, const IntegerTriangle& b) {
  const Integers na = opposite(a), nb = opposite(b);
  if (na.isZero() || nb.isZero()) return false;
  std::vector<Integers> axes{na, nb};
  for (int i = 0; i < 3; ++i) {
    const Integers ea = a[(i + 1) % 3] - a[i];
    axes.push_back(na.cross(ea));
    for (int j = 0; j < 3; ++j) {
      const Integers eb = b[(j + 1) % 3] - b[j];
      if (i == 0) axes.push_back(nb.cross(eb));
      axes.push_back(ea.cross(eb));
    }
  }
  for (const Integers& axis : axes) {
    if (axis.isZero()) continue;
    const auto [a_low, a_high] = std::minmax({axis.dot(a[0]), axis.dot(a[1]), axis.dot(a[2])});
    const auto [b_low, b_high] = std::minmax({axis.dot(b[0]), axis.dot(b[1]), axis.dot(b[2])});
    if (a_high < b_low || b_high < a_low) return false;
  }
  return true;
}

/// Corners on a small grid, so that touching, coplanar and degenerate cases are common.
IntegerTriangle random_triangle(std::mt19937_64& random, int extent) {
  IntegerTriangle t;
  for (Integers& corner : t)
    for (int axis = 0; axis < 3; ++axis) corner[axis] = static_cast<std::int64_t>(random() % (extent + 1));
  return t;
}

class TrianglePairOnAGrid : public ::testing::TestWithParam<int> {};

TEST_P(TrianglePairOnAGrid, IntersectsExactlyWhenNoAxisSeparates) {
  std::mt19937_64 random{7};
  int intersecting = 0, apart = 0;
  for (int round = 0; round < 200000; ++round) {
    const IntegerTriangle f = random_triangle(random, GetParam()), g = random_triangle(random, GetParam());
    PairContact contact;
    const bool expected = no_axis_separates(f, g);
    // A scale by a power of two is exact.
    ASSERT_EQ(intersect(as_double(f), as_double(g), contact), expected) << "round " << round;
    ASSERT_EQ(intersect(as_double(f, 0x1p-10), as_double(g, 0x1p-10), contact), expected) << "round " << round;
    ++(expected ? intersecting : apart);
  }
  EXPECT_GT(intersecting, 1000);
  EXPECT_GT(apart, 1000);
}

INSTANTIATE_TEST_SUITE_P(Extent, TrianglePairOnAGrid, ::testing::Values(1, 2, 3, 6, 20, 300));

double distance_to(const Vec3d& p, const Triangle3d& t) {
  const Vec3d n = (t[1] - t[0]).cross(t[2] - t[0]).normalized();
  double distance = std::abs(n.dot(p - t[0]));
  for (int i = 0; i < 3; ++i) {
    const Vec3d inward = n.cross(t[(i + 1) % 3] - t[i]).normalized();
    distance = std::max(distance, -inward.dot(p - t[i]));
  }
  return distance;
}

TEST(TrianglePair, TheContactPointLiesInBothTriangles) {
  std::mt19937_64 random{8};
  int intersecting = 0;
  for (int round = 0; round < 100000; ++round) {
    const int extent = round % 2 == 0 ? 3 : 100;
    const Triangle3d f = as_double(random_triangle(random, extent)), g = as_double(random_triangle(random, extent));
    PairContact contact;
    if (!intersect(f, g, contact)) continue;
    ++intersecting;
    const double tolerance = 1e-12 * extent * extent;
    ASSERT_LT(distance_to(contact.point, f), tolerance) << "round " << round;
    ASSERT_LT(distance_to(contact.point, g), tolerance) << "round " << round;
  }
  EXPECT_GT(intersecting, 1000);
}

Triangle3d moved(const Triangle3d& t, const Vec3d& displacement) {
  return {t[0] + displacement, t[1] + displacement, t[2] + displacement};
}

TEST(TrianglePair, MovingTheProbeByTheDepthSeparatesThePair) {
  std::mt19937_64 random{9};
  for (int round = 0; round < 50000; ++round) {
    const Triangle3d f = as_double(random_triangle(random, 4)), g = as_double(random_triangle(random, 4));
    PairContact contact, ignored;
    if (!intersect(f, g, contact)) continue;
    ASSERT_NEAR(contact.normal.norm(), 1, 1e-12);
    ASSERT_GE(contact.depth, 0);
    ASSERT_FALSE(intersect(f, moved(g, (contact.depth + 1e-7) * contact.normal), ignored)) << "round " << round;
  }
}

TEST(TrianglePair, MovingTheProbeByLessThanTheDepthDoesNotSeparateThePair) {
  std::mt19937_64 random{11};
  // Coordinates in general position, because rounding can miss the contact of a single corner.
  std::normal_distribution<double> normal;
  int deep = 0;
  for (int round = 0; round < 50000; ++round) {
    Triangle3d f, g;
    for (int corner = 0; corner < 3; ++corner)
      for (int axis = 0; axis < 3; ++axis) {
        f[corner][axis] = normal(random);
        g[corner][axis] = normal(random);
      }
    PairContact contact, ignored;
    if (!intersect(f, g, contact) || contact.depth < 1e-6) continue;
    ++deep;
    ASSERT_TRUE(intersect(f, moved(g, (contact.depth - 1e-7) * contact.normal), ignored)) << "round " << round;
    ASSERT_FALSE(intersect(f, moved(g, (contact.depth + 1e-7) * contact.normal), ignored)) << "round " << round;
  }
  EXPECT_GT(deep, 1000);
}

TEST(TrianglePair, EveryInstructionSetGivesTheSameBits) {
  std::mt19937_64 random{10};
  std::normal_distribution<double> normal;
  for (int round = 0; round < 20000; ++round) {
    TrianglePairs pairs;
    for (int corner = 0; corner < 3; ++corner)
      for (int axis = 0; axis < 3; ++axis)
        for (int lane = 0; lane < TrianglePairs::kWidth; ++lane) {
          const auto value = [&] { return round % 2 == 0 ? normal(random) : static_cast<double>(random() % 4); };
          pairs.object[corner][axis][lane] = value();
          pairs.probe[corner][axis][lane] = value();
        }
    const unsigned count = 1 + static_cast<unsigned>(random() % TrianglePairs::kWidth);
    PairContacts expected;
    const unsigned intersecting = intersect(pairs, count, expected, Simd::kBase);
    for (unsigned lane = 0; lane < count; ++lane) {
      Triangle3d f, g;
      for (int corner = 0; corner < 3; ++corner)
        for (int axis = 0; axis < 3; ++axis) {
          f[corner][axis] = pairs.object[corner][axis][lane];
          g[corner][axis] = pairs.probe[corner][axis][lane];
        }
      PairContact single;
      ASSERT_EQ(intersect(f, g, single), (intersecting >> lane & 1u) != 0);
      if ((intersecting >> lane & 1u) == 0) continue;
      for (int axis = 0; axis < 3; ++axis) {
        ASSERT_EQ(single.point[axis], expected.point[axis][lane]);
        ASSERT_EQ(single.normal[axis], expected.normal[axis][lane]);
      }
      ASSERT_EQ(single.depth, expected.depth[lane]);
    }
    for (const Simd simd : {Simd::kAvx2, Simd::kAvx512}) {
      if (simd > best_simd()) continue;
      PairContacts found;
      ASSERT_EQ(intersect(pairs, count, found, simd), intersecting);
      for (unsigned lane = 0; lane < count; ++lane) {
        if ((intersecting >> lane & 1u) == 0) continue;
        for (int axis = 0; axis < 3; ++axis) {
          ASSERT_EQ(found.point[axis][lane], expected.point[axis][lane]);
          ASSERT_EQ(found.normal[axis][lane], expected.normal[axis][lane]);
        }
        ASSERT_EQ(found.depth[lane], expected.depth[lane]);
      }
    }
  }
}

TEST(Orientation, IsExactToOneUnitInTheLastPlace) {
  // A point on the plane x + y + z = 1, and two points whose z differs from it by one unit in the last place.
  const Vec3d a{1, 0, 0}, b{0, 1, 0}, c{0, 0, 1};
  EXPECT_EQ(orientation(a, b, c, {0.25, 0.25, 0.5}), 0);
  EXPECT_EQ(orientation(a, b, c, {0.25, 0.25, std::nextafter(0.5, 1.0)}), 1);
  EXPECT_EQ(orientation(a, b, c, {0.25, 0.25, std::nextafter(0.5, 0.0)}), -1);
  EXPECT_EQ(orientation(Vec3d{0, 0, 0}, {1, 1, 0}, {0.5, std::nextafter(0.5, 1.0), 0}, 0, 1), 1);
  EXPECT_EQ(orientation(Vec3d{0, 0, 0}, {1, 1, 0}, {0.5, 0.5, 0}, 0, 1), 0);
}

}  // namespace
}  // namespace tactus::spm
