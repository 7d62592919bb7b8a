#include "haptics/passivity.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "haptics/simulated_device.hpp"
#include "tests/support/constants.hpp"

namespace tactus::haptics {
namespace {

struct PressResult {
  double min_energy;  // J, received from the hand minus returned to the hand
  double max_force;   // N
};

/// A hand presses a sampled wall and leaves it, repeatedly. The damping of the device is too small for the stiffness of
/// the wall. `control`: false switches the passivity controller off.
PressResult press(double stiffness, double speed, bool control, unsigned seed) {
  DeviceSpec spec;
  spec.damping = 0.2;
  HandSettings hand;
  hand.start = {0, 0, 0.02};
  hand.tremor = 2e-4;
  hand.seed = seed;
  SimulatedDevice device{hand, spec};
  PassivityController port;
  double max_force = 0, energy = 0, min_energy = 0;
  Vec3d force = Vec3d::Zero(), before = hand.start;
  const int cycles = 8000;
  for (int i = 0; i < cycles; ++i) {
    HandPath path;
    path.count = 1;
    const double phase = std::fmod(i * kCycle * speed / 0.06, 1.0);
    path.waypoints[0] = {0, {0, 0, 0.02 - 0.06 * (phase < 0.5 ? phase : 1 - phase)}};
    device.paths().post(path);
    const DeviceState state = device.read(i * 1'000'000LL);
    // Counts the energy at the hand independently of the passivity controller.
    energy -= force.dot(state.position - before);
    min_energy = std::min(min_energy, energy);
    before = state.position;
    const Vec3d wall{0, 0, stiffness * std::max(0.0, -state.position.z())};
    force = port.step(wall, state.position, 0, kCycle, control);
    device.write(force);
    max_force = std::max(max_force, force.norm());
  }
  return {min_energy, max_force};
}

TEST(Passivity, WithholdsTheExcessEnergyOfASampledWall) {
  for (const double stiffness : {500.0, 2000.0, 4000.0}) {
    for (const double speed : {0.05, 0.2, 0.5}) {
      const PressResult uncontrolled = press(stiffness, speed, false, 1);
      const PressResult controlled = press(stiffness, speed, true, 1);
      EXPECT_LT(uncontrolled.min_energy, -1e-5) << stiffness << " N/m at " << speed << " m/s";
      EXPECT_GT(controlled.min_energy, -1e-6) << stiffness << " N/m at " << speed << " m/s";
      EXPECT_GT(controlled.max_force, 0.7 * uncontrolled.max_force) << stiffness << " N/m at " << speed << " m/s";
    }
  }
}

TEST(Passivity, EnergyFromAnotherPortMayGoToTheHand) {
  PassivityController port;
  const Vec3d force{2, 0, 0};
  Vec3d position = Vec3d::Zero();
  Vec3d felt_force = port.step(force, position, 0, kCycle);
  // A body pushes the hand and loses the energy that the hand gains.
  for (int i = 0; i < 1000; ++i) {
    position.x() += 1e-4;
    felt_force = port.step(force, position, -2e-4 - 1e-6, kCycle);
  }
  EXPECT_EQ(felt_force, force);
  EXPECT_GE(port.ledger().lowest, -1e-6);
}

TEST(Passivity, WithoutEnergyOnlyForcesAlongTheMotionAreWithheld) {
  PassivityController port;
  Vec3d position = Vec3d::Zero();
  (void)port.step(Vec3d::Zero(), position, 0, kCycle);
  position.x() += 1e-4;
  EXPECT_LT(port.step({2, 0, 0}, position, 0, kCycle).norm(), 0.01);
  position.x() += 1e-4;
  EXPECT_EQ(port.step({-2, 0, 0}, position, 0, kCycle), Vec3d(-2, 0, 0));
}

TEST(Passivity, RepaysADeficitByDampingWithinTheLimitOfTheDevice) {
  const PassivitySettings settings;
  PassivityController port{settings};
  Vec3d position = Vec3d::Zero();
  (void)port.step(Vec3d::Zero(), position, 0, kCycle);
  position.x() += 1e-4;
  const Vec3d braking = port.step(Vec3d::Zero(), position, 1e-3, kCycle);  // 1 mJ was passed on to a body
  EXPECT_LT(braking.x(), 0);
  EXPECT_LE(braking.norm(), settings.device_mass / kCycle * 0.1 * (1 + 1e-9));
  double last_energy = port.ledger().energy;
  for (int i = 0; i < 200; ++i) {
    position.x() += 1e-4;
    (void)port.step(Vec3d::Zero(), position, 0, kCycle);
    ASSERT_GE(port.ledger().energy, last_energy);
    last_energy = port.ledger().energy;
  }
  EXPECT_GT(last_energy, -1e-6);
}

TEST(Passivity, AllowsTheEnergyOfASpringAsCreditAtAnyDisplacement) {
  constexpr double kStiffness = 1000;
  PassivityController port;
  Vec3d position = Vec3d::Zero(), felt_force = Vec3d::Zero();
  const auto move_to = [&](double x) {
    position.x() = x;
    felt_force = port.step({-kStiffness * x, 0, 0}, position, 0, kCycle, true, 0.5 * kStiffness * x * x);
  };
  constexpr double kMaxDepth = 0.02;  // m: 0.2 J, more than the credit bound
  for (int i = 0; i <= 2000; ++i) move_to(kMaxDepth * i / 2000);
  EXPECT_GT(port.ledger().energy, 0.19);
  for (int i = 2000; i >= 200; --i) {
    move_to(kMaxDepth * i / 2000);
    ASSERT_EQ(felt_force.x(), -kStiffness * position.x()) << "at " << position.x();
  }
  EXPECT_GE(port.ledger().lowest, -1e-6);
}

TEST(Passivity, BoundsTheCreditAndRefusesInputThatIsNotFinite) {
  PassivityController port;
  Vec3d position = Vec3d::Zero();
  (void)port.step({-5, 0, 0}, position, 0, kCycle);
  for (int i = 0; i < 1000; ++i) {
    position.x() += 1e-4;
    (void)port.step({-5, 0, 0}, position, 0, kCycle);
  }
  EXPECT_EQ(port.ledger().energy, PassivitySettings{}.credit);
  EXPECT_NEAR(port.ledger().discarded, 0.5 - PassivitySettings{}.credit, 1e-3);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(port.step({nan, 0, 0}, position, 0, kCycle).norm(), 0);
  EXPECT_EQ(port.step({1, 0, 0}, {nan, 0, 0}, 0, kCycle).norm(), 0);
  EXPECT_EQ(port.ledger().invalid_inputs, 2u);
  EXPECT_TRUE(std::isfinite(port.ledger().energy));
}

// A rise of strength that costs energy is limited to the energy of earlier falls.
TEST(StrengthLimiter, LimitsARiseOnlyIfTheSpringIsLongerThanAtTheFall) {
  constexpr double kStored = 0.01;  // J
  StrengthLimiter limiter;
  EXPECT_EQ(limiter.step(1, kStored, kStored), 1) << "the first strength";
  EXPECT_EQ(limiter.step(0.25, kStored, kStored), 0.25);
  EXPECT_EQ(limiter.step(1, kStored, 0), 1) << "as long as before";
  EXPECT_EQ(limiter.step(0, kStored, 0), 0);
  EXPECT_DOUBLE_EQ(limiter.step(1, 4 * kStored, 0), 0.25) << "four times the energy";
  EXPECT_DOUBLE_EQ(limiter.step(1, 4 * kStored, 2 * kStored), 0.5) << "the hand has given more";
  EXPECT_EQ(limiter.step(1, 1e-9, 0), 1) << "the hand is back at the body";
  (void)limiter.step(0, kStored, 0);
  limiter.reset();
  EXPECT_EQ(limiter.step(0.5, kStored, 0), 0.5) << "another contact";
}

TEST(StrengthLimiter, ASpringWithChangingStrengthNeverGivesMoreThanItHasReceived) {
  constexpr double kStiffness = 1000, kSpeed = 2e-4;  // N/m; m in a step
  std::mt19937_64 random{7};
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution{from, to}(random); };
  for (int run = 0; run < 100; ++run) {
    StrengthLimiter limiter;
    double stretch = 0, strength = 1, energy = 0, lowest = 0;
    int limited = 0;
    for (int step = 0; step < 2000; ++step) {
      const double before = stretch;
      stretch = std::clamp(stretch + uniform(-kSpeed, kSpeed), 0.0, 0.01);
      energy += strength * 0.5 * kStiffness * (stretch * stretch - before * before);  // work of the ends
      const double wanted = step / 100 % 2 == 0 ? uniform(0.9, 1) : uniform(0, 0.5);
      strength = limiter.step(wanted, 0.5 * kStiffness * stretch * stretch, energy);
      ASSERT_LE(strength, wanted);
      limited += strength < wanted ? 1 : 0;
      lowest = std::min(lowest, energy);
    }
    EXPECT_GE(lowest, -1e-6) << "run " << run;
    EXPECT_GT(limited, 0) << "run " << run;
  }
}

}  // namespace
}  // namespace tactus::haptics
