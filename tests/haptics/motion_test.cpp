#include <gtest/gtest.h>

#include <cctype>
#include <string>
#include <utility>

#include "haptics/proxy.hpp"
#include "tests/haptics/friction_run.hpp"
#include "tests/haptics/moving_bodies.hpp"
#include "tests/haptics/random_motions.hpp"
#include "tests/support/constants.hpp"

namespace tactus::haptics {
namespace {

using namespace testing;

constexpr std::uint64_t kMotionSeed = 20054;
constexpr double kRadius = 0.003;

class RandomMotions : public ::testing::TestWithParam<MotionScene> {};

TEST_P(RandomMotions, NeverCarryTheProxyIntoAClosedSurface) {
  constexpr std::uint64_t kMotions = 4000;  // for each scene and friction; scripts/bench fidelity runs 10^7 in total
  for (const double friction : {0.0, 0.6}) {
    const MotionResult result = run_motions(GetParam(), kMotions, friction, kMotionSeed);
    EXPECT_EQ(result.passed, 0u) << "friction " << friction << ", seed " << kMotionSeed << ": " << result.what;
    EXPECT_GT(result.contacts, 100u);
    if (!GetParam().may_crush) {
      EXPECT_LT(result.deepest, 1e-9);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, RandomMotions, ::testing::ValuesIn(motion_scenes()), [](const auto& scene) {
  std::string name = scene.param.name;
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  return name;
});

TEST(RandomMotions, CarryTheProxyIntoBodiesWhoseMotionIsHiddenFromIt) {
  for (const MotionScene& scene : motion_scenes())
    if (scene.bodies[0].speed * kCycle > kRadius) {
      EXPECT_GT(run_motions(scene, 4000, 0, kMotionSeed, false).passed, 0u) << scene.name;
    }
}

TEST(Friction, TheForceOfACurvedSurfaceIsInsideTheStaticConeOrOnTheDynamicCone) {
  for (const double radius : {0.02, 0.05, 100.0})
    for (const bool hollow : {false, true})
      for (const auto& [static_friction, dynamic_friction] : {std::pair{0.5, 0.3}, {0.8, 0.75}, {0.2, 0.2}}) {
        const FrictionResult result =
            run_friction(AnalyticSphere{radius, hollow}, static_friction, dynamic_friction, 0.1, 20000, kMotionSeed);
        SCOPED_TRACE(::testing::Message() << "radius " << radius << " hollow " << hollow << " coefficients "
                                          << static_friction << ' ' << dynamic_friction << " seed " << kMotionSeed);
        EXPECT_LT(result.stick_error, 0.01);
        EXPECT_LT(result.slip_error, 0.01);
        EXPECT_GT(result.sticking, 500u);
        EXPECT_GT(result.slipping, 5000u);
        // After a slip the proxy sticks again only if the force is well inside the static cone (hysteresis).
        EXPECT_GT(result.max_stuck, 0.99);
        EXPECT_GT(result.stuck_again, 10u);
        EXPECT_LT(result.max_return, 0.71);
      }
}

BodyPose translated_by(double x, double z) { return {Eigen::Matrix3d::Identity(), {x, 0, z}}; }

TEST(MovingBodies, CarryAStickingProxy) {
  MovingBodies bodies;
  bodies.add(box(0.05));
  Proxy proxy;
  proxy.set_grip({0.8, 0.6});
  const double contact_height = 0.05 + kRadius;
  (void)proxy.step({0, 0, 0.06}, kCycle, bodies, false);
  const double depth = 0.002;
  for (int i = 0; i <= 10; ++i) {
    bodies.start_step();
    bodies.move(0, translated_by(1e-4 * i, 1e-4 * i));
    (void)proxy.step({0, 0, contact_height - depth + 1e-4 * i}, kCycle, bodies, false);
  }
  EXPECT_TRUE(proxy.last().sticking);
  EXPECT_NEAR(proxy.last().proxy.x(), 1e-3, 1e-6);
  EXPECT_NEAR(proxy.last().proxy.z(), contact_height + 1e-3, 2e-6);
  EXPECT_LT((proxy.last().surface_velocity - Vec3d(0.1, 0, 0.1)).norm(), 1e-6);
}

TEST(MovingBodies, SlideUnderAProxyWithoutFriction) {
  MovingBodies bodies;
  bodies.add(box(0.05));
  Proxy proxy;
  (void)proxy.step({0, 0, 0.06}, kCycle, bodies, false);
  for (int i = 0; i <= 10; ++i) {
    bodies.start_step();
    bodies.move(0, translated_by(1e-4 * i, -1e-4 * i));
    (void)proxy.step({0, 0, 0.04}, kCycle, bodies, false);
  }
  EXPECT_NEAR(proxy.last().proxy.x(), 0, 1e-9);
  EXPECT_NEAR(proxy.last().proxy.z(), 0.049 + kRadius, 2e-6);
}

TEST(MovingBodies, PushATipAtRestAtAnySpeed) {
  for (const double step : {1e-5, 1e-3, 0.02, 0.09}) {
    MovingBodies bodies;
    bodies.add(box(0.005), translated_by(0, -0.1));
    Proxy proxy;
    const Vec3d device{0.001, 0.002, 0};
    (void)proxy.step(device, kCycle, bodies, false);
    for (double z = -0.1; z < 0.05;) {
      z += step;
      bodies.start_step();
      bodies.move(0, translated_by(0, z));
      const ProxyResult& touch = proxy.step(device, kCycle, bodies, false);
      ASSERT_GE(touch.proxy.z(), std::min(z + 0.005 + kRadius, 0.0)) << step << " m per cycle, at " << z;
      ASSERT_EQ(touch.in_contact, z + 0.005 + kRadius > 0);
    }
  }
}

TEST(MovingBodies, KeepTheCentreOfASqueezedTipOutsideUntilTheGapIsTooNarrow) {
  // The gap between two blocks closes from 20 mm to 0.1 mm and opens again.
  MovingBodies bodies;
  bodies.add(box(0.05), translated_by(0, -0.05));
  bodies.add(box(0.05), translated_by(0, 0.07));
  Proxy proxy;
  const Vec3d device{0, 0, 0.005};
  (void)proxy.step(device, kCycle, bodies, false);
  int without_contact = 0;
  for (int i = 1; i <= 400; ++i) {
    const double gap = 1e-4 * std::max(1, std::abs(200 - i));
    bodies.start_step();
    bodies.move(1, translated_by(0, gap + 0.05));
    const ProxyResult& touch = proxy.step(device, kCycle, bodies, false);
    if (touch.outside_only) {
      ++without_contact;
      continue;
    }
    ASSERT_GT(touch.proxy.z(), 0) << "gap " << gap;
    ASSERT_LT(touch.proxy.z(), gap) << "gap " << gap;
  }
  EXPECT_GT(without_contact, 0);
  EXPECT_FALSE(proxy.last().outside_only) << "the gap is wide again";
  EXPECT_EQ(proxy.last().proxy, device);
}

}  // namespace
}  // namespace tactus::haptics
