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

constexpr LimitedSpring kSpring{1000, 8};
constexpr double kLength = 0.004;  // m, at which the spring is linear

TEST(LimitedSpring, StretchIsTheInverseOfEnergy) {
  for (const double stretch : {0.0, 0.001, 0.008, 0.05})
    EXPECT_NEAR(kSpring.stretch(kSpring.energy(stretch)), stretch, 1e-12);
  EXPECT_DOUBLE_EQ(kSpring.energy(0.004), 0.5 * 1000 * 0.004 * 0.004);
  EXPECT_DOUBLE_EQ(kSpring.energy(0.009) - kSpring.energy(0.008), 8 * 0.001) << "the force is at its limit";
}

// A rise of strength that costs energy is limited to the energy of earlier falls.
TEST(SpringLimiter, LimitsARiseOnlyIfTheSpringIsLongerThanAtTheFall) {
  const double stored = kSpring.energy(kLength);
  SpringLimiter limiter;
  EXPECT_EQ(limiter.step(1, kSpring, kLength, stored), 0) << "the first strength";
  EXPECT_EQ(limiter.step(0.25, kSpring, kLength, stored), 0);
  EXPECT_EQ(limiter.step(1, kSpring, kLength, 0), 0) << "as long as before";
  EXPECT_EQ(limiter.step(0, kSpring, kLength, 0), 0);
  EXPECT_NEAR(limiter.step(1, kSpring, 1.5 * kLength, 0), 0.5 * kLength, 1e-12);
  EXPECT_EQ(limiter.step(1, kSpring, 1e-5, 0), 0) << "the hand is back at the body";
  (void)limiter.step(0, kSpring, kLength, 0);
  limiter.reset();
  EXPECT_EQ(limiter.step(0.5, kSpring, kLength, 0), 0) << "another contact";
}

TEST(SpringLimiter, ALongerSpringKeepsItsStiffnessAndGetsARestLength) {
  SpringLimiter limiter;
  const auto force = [&](double strength, double length, double energy) {
    return strength * kSpring.force(length - limiter.step(strength, kSpring, length, energy));
  };
  double energy = kSpring.energy(kLength);
  (void)force(1, kLength, energy);
  for (const double strength : {0.5, 0.0}) (void)force(strength, kLength, energy);
  // Meanwhile the hand has moved 10 mm deeper.
  const double deep = kLength + 0.01;
  for (int step = 0; step <= 100; ++step) (void)force(0.01 * step, deep, energy);
  EXPECT_NEAR(force(1, deep, energy), 4, 1e-9) << "the force before the fall";
  EXPECT_NEAR(force(1, deep + 0.001, energy += 4.5e-3), 5, 1e-6) << "1 mm deeper, 1 N more";
  EXPECT_NEAR(force(1, deep - 0.003, energy -= 12e-3), 1, 1e-6);
  EXPECT_NEAR(force(1, deep - 0.006, energy -= 0.5e-3), 0, 1e-6) << "the hand is not farther than the rest length";
  EXPECT_NEAR(force(1, deep - 0.005, energy += 0.5e-3), 1, 1e-6) << "and the rest length has decreased";
  EXPECT_NEAR(force(1, deep - 0.005, energy += 0.1), 8, 1e-9) << "the hand has given more";
}

TEST(SpringLimiter, AShortInterruptionEndsNoRestLength) {
  for (const int cycles : {1, 100, 101}) {
    SpringLimiter limiter;
    const double energy = kSpring.energy(kLength);
    for (const double strength : {1.0, 0.0}) (void)limiter.step(strength, kSpring, kLength, energy);
    EXPECT_NEAR(limiter.step(1, kSpring, 3 * kLength, energy), 2 * kLength, 1e-12);
    for (int cycle = 0; cycle < cycles; ++cycle) limiter.interrupt();
    EXPECT_NEAR(limiter.step(1, kSpring, 4 * kLength, energy), cycles <= 100 ? 3 * kLength : 0, 1e-12);
  }
}

TEST(SpringLimiter, ASpringWithChangingStrengthNeverGivesMoreThanItHasReceived) {
  constexpr double kSpeed = 4e-4, kMaxLength = 0.02;  // m in a step; m
  std::mt19937_64 random{7};
  const auto uniform = [&](double from, double to) { return std::uniform_real_distribution{from, to}(random); };
  for (int run = 0; run < 100; ++run) {
    SpringLimiter limiter;
    double length = 0, rest_length = 0, strength = 1, energy = 0, lowest = 0;
    int limited = 0;
    for (int step = 0; step < 2000; ++step) {
      // While the ends move, strength and rest length are constant.
      const auto stored = [&] { return strength * kSpring.energy(std::max(0.0, length - rest_length)); };
      const double before = stored();
      length = std::clamp(length + uniform(-kSpeed, kSpeed), 0.0, kMaxLength);
      energy += stored() - before;
      strength = step / 100 % 2 == 0 ? uniform(0.9, 1) : uniform(0, 0.5);
      rest_length = limiter.step(strength, kSpring, length, energy);
      ASSERT_LE(rest_length, length);
      limited += rest_length > 0 ? 1 : 0;
      lowest = std::min(lowest, energy);
    }
    EXPECT_GE(lowest, -1e-6) << "run " << run;
    EXPECT_GT(limited, 0) << "run " << run;
  }
}

}  // namespace
}  // namespace tactus::haptics
