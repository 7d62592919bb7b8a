#include "spm/triangle.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <random>
#include <vector>

namespace tactus::spm {
namespace {

struct Triangle {
  Vec3d a, b, c;
};

class Random {
 public:
  explicit Random(unsigned seed) : engine_{seed} {}
  double uniform(double low, double high) { return std::uniform_real_distribution<double>{low, high}(engine_); }
  Vec3d point(double size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }
  /// One triangle in four is a needle, a segment or a point.
  Triangle triangle() {
    Triangle t{point(1), point(1), point(1)};
    switch (static_cast<int>(uniform(0, 12))) {
      case 0:
        t.c = t.a + (t.b - t.a) * uniform(-0.5, 1.5);
        break;
      case 1:
        t.c = t.a + (t.b - t.a) * uniform(0, 1) + point(1e-7);
        break;
      case 2:
        t.c = t.b;
        if (uniform(0, 1) < 0.5) t.a = t.b;
        break;
      default:
        break;
    }
    return t;
  }

 private:
  std::mt19937 engine_;
};

/// Returns the minimum of a convex function on [0, 1].
template <class Function>
double min(Function f) {
  double low = 0;
  double high = 1;
  for (int i = 0; i < 60; ++i) {
    const double left = low + (high - low) / 3;
    const double right = high - (high - low) / 3;
    (f(left) < f(right) ? high : low) = f(left) < f(right) ? right : left;
  }
  return f(0.5 * (low + high));
}

/// Returns the distance by a nested search over the points a + s (b - a + r (c - b)), without distinction of face,
/// edges and vertices.
double searched_distance(const Vec3d& p, const Triangle& t) {
  return min(
      [&](double s) { return min([&](double r) { return (p - (t.a + s * (t.b - t.a + r * (t.c - t.b)))).norm(); }); });
}

double distance(const Vec3d& p, const Triangle& t) {
  return std::sqrt(closest_point(p, t.a, t.b, t.c).squared_distance);
}

/// Returns the first of `count` + 1 evenly spaced times from 0 to 1 at which the sphere touches, or 2 if there is none.
double sampled_touch(const Vec3d& from, const Vec3d& to, double radius, const Triangle& t, int count) {
  for (int i = 0; i <= count; ++i) {
    const double time = static_cast<double>(i) / count;
    if (distance(from + (to - from) * time, t) <= radius) return time;
  }
  return 2;
}

constexpr unsigned kTriangleSeed = 20051;

TEST(ClosestPoint, HasTheDistanceThatASearchOfTheTriangleFinds) {
  Random random{kTriangleSeed};
  for (int round = 0; round < 1500; ++round) {
    const Triangle t = random.triangle();
    const Vec3d p = random.point(2);
    const ClosestPoint found = closest_point(p, t.a, t.b, t.c);
    ASSERT_NEAR(std::sqrt(found.squared_distance), searched_distance(p, t), 1e-8) << "round " << round;
    ASSERT_NEAR((p - found.point).squaredNorm(), found.squared_distance, 1e-14) << "round " << round;
    ASSERT_LT(searched_distance(found.point, t), 1e-8) << "round " << round;
  }
}

TEST(ClosestPoint, NamesTheFeatureOnWhichItLies) {
  const Triangle t{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  const auto feature = [&](double x, double y, double z) { return closest_point({x, y, z}, t.a, t.b, t.c).feature; };
  EXPECT_EQ(feature(0.2, 0.2, 0.5), Feature::kFace);
  EXPECT_EQ(feature(0.2, 0.2, -0.5), Feature::kFace);
  EXPECT_EQ(feature(0.5, -0.2, 0.1), Feature::kEdgeAb);
  EXPECT_EQ(feature(0.7, 0.7, 0.1), Feature::kEdgeBc);
  EXPECT_EQ(feature(-0.2, 0.5, 0.1), Feature::kEdgeCa);
  EXPECT_EQ(feature(-0.2, -0.2, 0.1), Feature::kVertexA);
  EXPECT_EQ(feature(1.2, -0.2, 0.1), Feature::kVertexB);
  EXPECT_EQ(feature(-0.2, 1.2, 0.1), Feature::kVertexC);
}

TEST(SweptSphere, HitsNoLaterThanASampledSphereTouches) {
  Random random{kTriangleSeed + 1};
  constexpr int kSamples = 2000;
  int touched = 0;
  for (int round = 0; round < 4000; ++round) {
    const Triangle t = random.triangle();
    const Vec3d from = random.point(2);
    const Vec3d to = random.point(2);
    const double radius = round % 4 == 0 ? 1e-3 : random.uniform(0.01, 0.5);
    if (distance(from, t) <= radius) continue;
    const double expected = sampled_touch(from, to, radius, t, kSamples);
    SweepHit hit{};
    const bool found = swept_sphere(from, to, radius, t.a, t.b, t.c, hit);
    if (expected <= 1) {
      ++touched;
      ASSERT_TRUE(found) << "round " << round;
      ASSERT_LE(hit.time, expected) << "round " << round;
    }
    if (found) {
      const Vec3d centre = from + (to - from) * hit.time;
      // The samples can miss a short contact that the sweep finds. Therefore check the contact itself, too.
      ASSERT_NEAR(distance(centre, t), radius, 1e-9) << "round " << round;
      ASSERT_NEAR(hit.normal.norm(), 1, 1e-12) << "round " << round;
      ASSERT_LT((hit.point + hit.normal * radius - centre).norm(), 1e-9) << "round " << round;
      if (expected <= 1) {
        ASSERT_GT(hit.time, expected - 1.0 / kSamples - 1e-9) << "round " << round;
      }
    }
  }
  EXPECT_GT(touched, 200);
}

TEST(SweptSphere, NeverPenetratesAtTheTimeOfImpact) {
  Random random{kTriangleSeed + 2};
  for (int round = 0; round < 5000; ++round) {
    const Triangle t = random.triangle();
    const Vec3d from = random.point(2);
    const Vec3d to = random.point(2);
    const double radius = random.uniform(0, 0.3);
    if (distance(from, t) <= radius) continue;
    SweepHit hit{};
    if (!swept_sphere(from, to, radius, t.a, t.b, t.c, hit)) continue;
    ASSERT_GE(distance(from + (to - from) * hit.time, t), radius - 1e-14) << "round " << round;
  }
}

TEST(SweptSphere, APointHitsAFaceFromEitherSide) {
  Random random{kTriangleSeed + 3};
  for (int round = 0; round < 2000; ++round) {
    const Triangle t{random.point(1), random.point(1), random.point(1)};
    const Vec3d normal = (t.b - t.a).cross(t.c - t.a).normalized();
    double u = random.uniform(0.05, 1);
    double v = random.uniform(0.05, 1);
    double w = random.uniform(0.05, 1);
    const Vec3d inside = (u * t.a + v * t.b + w * t.c) / (u + v + w);
    const Vec3d motion = random.point(1);
    if (std::abs(motion.dot(normal)) < 1e-3) continue;
    SweepHit hit{};
    ASSERT_TRUE(swept_sphere(inside - motion, inside + motion, 0, t.a, t.b, t.c, hit)) << "round " << round;
    ASSERT_NEAR(hit.time, 0.5, 1e-9) << "round " << round;
    ASSERT_LT(hit.normal.dot(motion), 0) << "round " << round;
    ASSERT_NEAR(std::abs(hit.normal.dot(normal)), 1, 1e-6) << "round " << round;
  }
}

TEST(SweptSphere, HitsAtTimeZeroWhenItOverlapsAndMovesCloser) {
  Random random{kTriangleSeed + 4};
  int closer = 0;
  for (int round = 0; round < 5000; ++round) {
    const Triangle t = random.triangle();
    const Vec3d from = random.point(1.5);
    const double start = distance(from, t);
    const double radius = start * random.uniform(1.001, 2);
    const Vec3d to = from + random.point(0.5);
    const double shortly_after = distance(from + (to - from) * 1e-6, t);
    if (std::abs(shortly_after - start) < 1e-10) continue;
    SweepHit hit{};
    const bool found = swept_sphere(from, to, radius, t.a, t.b, t.c, hit);
    ASSERT_EQ(found, shortly_after < start) << "round " << round;
    if (found) {
      ++closer;
      ASSERT_EQ(hit.time, 0) << "round " << round;
    }
  }
  EXPECT_GT(closer, 1000);
}

TEST(SweptSphere, InContactWithAFaceCanSlideAlongItAndLeaveIt) {
  const Triangle t{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  const Vec3d in_contact{0.2, 0.2, 0.1};
  SweepHit hit{};
  EXPECT_FALSE(swept_sphere(in_contact, {0.6, 0.1, 0.1}, 0.1, t.a, t.b, t.c, hit));
  EXPECT_FALSE(swept_sphere(in_contact, {0.2, 0.2, 0.3}, 0.1, t.a, t.b, t.c, hit));
  EXPECT_TRUE(swept_sphere(in_contact, {0.6, 0.1, 0.09}, 0.1, t.a, t.b, t.c, hit));
}

TEST(SweptSphere, WithItsCentreOnTheTriangleCountsAsInFrontOfIt) {
  const Triangle t{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  const Vec3d centre{0.25, 0.25, 0};
  SweepHit hit{};
  EXPECT_TRUE(swept_sphere(centre, {0.25, 0.25, -1}, 0, t.a, t.b, t.c, hit));
  EXPECT_EQ(hit.time, 0);
  EXPECT_EQ(hit.normal, Vec3d(0, 0, 1));
  EXPECT_FALSE(swept_sphere(centre, {0.25, 0.25, 1}, 0, t.a, t.b, t.c, hit));
}

TEST(SweptSphere, DoesNotChangeTheHitWhenItMisses) {
  SweepHit hit{0.25, {1, 2, 3}, {0, 0, 1}, Feature::kEdgeBc};
  EXPECT_FALSE(swept_sphere({0, 0, 1}, {1, 0, 1}, 0.1, {0, 0, 0}, {1, 0, 0}, {0, 1, 0}, hit));
  EXPECT_EQ(hit.time, 0.25);
  EXPECT_EQ(hit.feature, Feature::kEdgeBc);
}

}  // namespace
}  // namespace tactus::spm
