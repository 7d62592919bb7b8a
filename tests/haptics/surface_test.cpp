#include "haptics/surface.hpp"

#include <gtest/gtest.h>

#include <random>

#include "tests/haptics/triangle_surface.hpp"

namespace tactus::haptics {
namespace {

using namespace testing;

constexpr unsigned kSurfaceSeed = 20052;

Vec3d random_point(std::mt19937& random, double size) {
  std::uniform_real_distribution<double> uniform{-size, size};
  return {uniform(random), uniform(random), uniform(random)};
}

TEST(ClosestSide, AgreesWithTheWindingNumberOnClosedSurfaces) {
  std::mt19937 random{kSurfaceSeed};
  for (const auto& triangles : {tetrahedron(1), sphere(1, 2), bumpy(1, 2, 0.25)}) {
    TriangleSurface surface{triangles};
    int inside = 0;
    for (int round = 0; round < 3000; ++round) {
      const Vec3d p = random_point(random, 1.3);
      SurfaceHit hit;
      ASSERT_TRUE(surface.closest(p, 10, hit));
      ASSERT_TRUE(hit.is_side_known);
      const double winding = winding_number(p, triangles);
      ASSERT_EQ(hit.distance<0, winding> 0.5) << "seed " << kSurfaceSeed << " round " << round;
      if (winding > 0.5) ++inside;
    }
    EXPECT_GT(inside, 100);
    EXPECT_LT(inside, 2900);
  }
}

TEST(ClosestSide, HasNoSideBeyondABorderOrWhereNormalsCancelOut) {
  SurfaceHit hit;
  ASSERT_TRUE(TriangleSurface{square(1, 0)}.closest({0.8, 0.1, -0.1}, 1, hit));
  EXPECT_FALSE(hit.is_side_known);
  EXPECT_GT(hit.distance, 0);
  const Triangle up{Vec3d{0, 0, 0}, Vec3d{1, 0, 0}, Vec3d{0, 1, 0}};
  const Triangle down{up[0], up[2], up[1]};
  ASSERT_TRUE((TriangleSurface{{up, down}}.closest({0.2, 0.2, -0.1}, 1, hit)));
  EXPECT_FALSE(hit.is_side_known);
  EXPECT_DOUBLE_EQ(hit.distance, 0.1);
}

TEST(ClosestSide, FindsNothingBeyondItsReach) {
  SurfaceHit hit;
  EXPECT_FALSE(TriangleSurface{square(1, 0)}.closest({0, 0, 0.5}, 0.4, hit));
  EXPECT_TRUE(TriangleSurface{square(1, 0)}.closest({0, 0, 0.5}, 0.6, hit));
  EXPECT_DOUBLE_EQ(hit.distance, 0.5);
  EXPECT_EQ(hit.normal, Vec3d(0, 0, 1));
}

TEST(FirstTouch, IsTheEarliestOfAllTriangles) {
  TriangleSurface surface{square(1, 0) + square(1, 0.3) + square(1, -0.3)};
  SurfaceHit hit;
  ASSERT_TRUE(surface.sweep({0.1, 0, 1}, {0.1, 0, -1}, 0.1, hit));
  EXPECT_NEAR(hit.time, 0.3, 1e-12);
  EXPECT_EQ(hit.face / 2, 1u);
  ASSERT_TRUE(surface.sweep({0.1, 0, -1}, {0.1, 0, 1}, 0.1, hit));
  EXPECT_NEAR(hit.time, 0.3, 1e-12);
  EXPECT_EQ(hit.face / 2, 2u);
  EXPECT_LT((hit.normal - Vec3d(0, 0, -1)).norm(), 1e-12);
}

}  // namespace
}  // namespace tactus::haptics
