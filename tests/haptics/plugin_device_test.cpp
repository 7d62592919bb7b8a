#include "haptics/plugin_device.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/constants.hpp"

namespace tactus::haptics {
namespace {

using testing::HasSubstr;

std::string open_error(const std::string& library, const std::string& config) {
  try {
    const PluginDevice device{library, config};
  } catch (const DeviceError& error) {
    return error.what();
  }
  return "";
}

TEST(PluginDevice, TheExampleDeviceSinksUntilTheForceCarriesItsWeight) {
  PluginDevice device{WEIGHT, "0.25"};
  EXPECT_EQ(device.name(), "weight in oil");
  EXPECT_EQ(device.spec().max_force, 5);
  EXPECT_EQ(device.spec().damping, 5);
  DeviceState state = device.read(kMs);
  EXPECT_EQ(state.position.z(), 0.25);
  const double floor = 0.2;
  double force = 0;
  for (int ms = 2; ms < 3000; ++ms) {
    force = 1000 * std::max(0.0, floor - state.position.z());
    device.write({0, 0, force});
    state = device.read(ms * kMs);
  }
  EXPECT_NEAR(force, 0.981, 1e-6);
  EXPECT_NEAR(state.velocity.z(), 0, 1e-6);
  EXPECT_EQ(device.health(), DeviceHealth::kReady);
}

TEST(PluginDevice, AnOpenErrorStatesTheFoundAndTheExpectedValue) {
  EXPECT_THAT(open_error("/nowhere/driver.so", ""), HasSubstr("/nowhere/driver.so: cannot open shared object file"));
  EXPECT_THAT(open_error(NO_ENTRY, ""), HasSubstr("found no function tactus_device_entry"));
  EXPECT_THAT(open_error(NO_DRIVER, ""), HasSubstr("tactus_device_entry returned NULL"));
  EXPECT_THAT(open_error(NEW_ABI, ""), HasSubstr("found ABI 3, expected 1 to 2"));
  EXPECT_THAT(open_error(NO_READ, ""), HasSubstr("found no function read"));
  EXPECT_THAT(open_error(BAD_SPEC, ""), HasSubstr("max_force: found -1.000000, expected a number above 0"));
  EXPECT_EQ(open_error(FAILS, "!x"), "device test, config '!x': found '!x', expected no exclamation mark");
  EXPECT_EQ(open_error(WEIGHT, "high"),
            "device weight in oil, config 'high': found 'high', expected a height in metres");
}

TEST(PluginDevice, SendsTorquesToDriversOfAbiTwoAndOnlyForcesToDriversOfAbiOne) {
  PluginDevice device{FAILS, ""};
  EXPECT_EQ(device.spec().max_torque, 0.25);
  device.write_wrench({2, 0, 0}, {0, 0, 0.125});
  EXPECT_EQ(device.read(kMs).position.y(), 2.125) << "the sum of force and torque";
  PluginDevice abi_one_device{OLD_ABI, ""};
  EXPECT_EQ(abi_one_device.spec().max_torque, 0);
  abi_one_device.write_wrench({2, 0, 0}, {0, 0, 0.125});
  EXPECT_EQ(abi_one_device.read(kMs).position.y(), 2);
}

TEST(PluginDevice, DerivesMissingVelocitiesFromPositions) {
  PluginDevice device{STALE, ""};
  DeviceState state;
  for (int ms = 1; ms <= 3; ++ms) state = device.read(ms * kMs);
  // Two steps of a low-pass filter with a time constant of 5 ms, towards 1 m/s.
  EXPECT_NEAR(state.velocity.x(), 1 - std::exp(-2 / 5.0), 1e-9);
}

TEST(PluginDevice, APoseAgesWithoutNewPosesAndTheDeviceStaysReady) {
  PluginDevice device{STALE, ""};
  for (int ms = 1; ms <= 10; ++ms) (void)device.read(ms * kMs);
  const DeviceState state = device.read(11 * kMs);
  EXPECT_EQ(state.time_ns, 3 * kMs);
  EXPECT_NEAR(state.position.x(), 0.003, 1e-12);
  EXPECT_EQ(device.health(), DeviceHealth::kReady);
}

TEST(PluginDevice, APoseWithAnUnchangedTimeAges) {
  PluginDevice device{REPEATS, ""};
  for (int ms = 1; ms <= 10; ++ms) (void)device.read(ms * kMs);
  const DeviceState state = device.read(80 * kMs);
  EXPECT_EQ(state.time_ns, kMs) << "the pose counts as measured at its first read, because its time was later";
  EXPECT_NEAR(state.position.x(), 0.011, 1e-12) << "times may be coarser than cycles";
  EXPECT_EQ(state.velocity, Vec3d(Vec3d::Zero()));
  EXPECT_EQ(state.buttons, 11u) << "a button may be the stop button, so the newest state counts";
  EXPECT_EQ(device.health(), DeviceHealth::kReady);
}

TEST(PluginDevice, DerivesVelocitiesAlsoIfTheTimesOfPosesAreAfterTheCalls) {  // otherwise the damping is missing
  PluginDevice device{AHEAD, ""};
  DeviceState state;
  for (int ms = 1; ms <= 3; ++ms) state = device.read(ms * kMs);
  EXPECT_NEAR(state.velocity.x(), 1 - std::exp(-2 / 5.0), 1e-9);
  EXPECT_EQ(device.health(), DeviceHealth::kReady);
}

TEST(PluginDevice, ATimeOfAnotherClockIsAFailure) {
  PluginDevice device{WALL_CLOCK, ""};
  for (int ms = 1; ms <= 3; ++ms) (void)device.read(ms * kMs);
  EXPECT_EQ(device.health(), DeviceHealth::kReady);
  EXPECT_EQ(device.ahead_ns(), 0);
  for (int ms = 4; ms <= 80; ++ms) EXPECT_EQ(device.read(ms * kMs).time_ns, 3 * kMs);
  EXPECT_EQ(device.health(), DeviceHealth::kFailed);
  EXPECT_GT(device.ahead_ns(), 0);
}

TEST(PluginDevice, AfterAFailureWritesOnlyAZeroForce) {
  PluginDevice device{FAILS, ""};
  device.write({2, 0, 0});
  for (int ms = 1; ms <= 3; ++ms) EXPECT_EQ(device.read(ms * kMs).position.y(), 2) << "the driver received the force";
  EXPECT_EQ(device.health(), DeviceHealth::kReady);
  (void)device.read(4 * kMs);
  EXPECT_EQ(device.health(), DeviceHealth::kFailed);
  device.write({3, 0, 0});
  device.write(Vec3d::Zero());
  EXPECT_EQ(device.health(), DeviceHealth::kFailed);
}

TEST(PluginDevice, ForwardsAPositionThatIsNotANumber) {  // the force renderer latches a fault
  PluginDevice device{NOT_A_NUMBER, ""};
  for (int ms = 1; ms <= 3; ++ms) EXPECT_TRUE(device.read(ms * kMs).position.allFinite());
  EXPECT_FALSE(device.read(4 * kMs).position.allFinite());
}

TEST(PluginDevice, DerivesVelocitiesAgainAfterAPositionThatIsNotANumber) {  // otherwise the fault returns after a reset
  PluginDevice device{NOT_A_NUMBER, ""};
  for (int ms = 1; ms <= 4; ++ms) (void)device.read(ms * kMs);
  EXPECT_EQ(device.read(5 * kMs).velocity, Vec3d(Vec3d::Zero())) << "the filter starts anew";
  for (int ms = 6; ms <= 7; ++ms) EXPECT_TRUE(device.read(ms * kMs).velocity.allFinite());
  EXPECT_NEAR(device.read(8 * kMs).velocity.x(), 1 - std::exp(-3 / 5.0), 1e-9);
}

}  // namespace
}  // namespace tactus::haptics
