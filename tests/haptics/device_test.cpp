#include "haptics/device.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <string>

#include "haptics/force.hpp"
#include "haptics/replay_device.hpp"
#include "haptics/simulated_device.hpp"
#include "tests/haptics/triangle_surface.hpp"
#include "tests/support/constants.hpp"

namespace tactus::haptics {
namespace {

using ::testing::HasSubstr;

HandPath path_to(const Vec3d& position, std::int64_t time_ns = 0) {
  HandPath path;
  path.count = 1;
  path.waypoints[0] = {time_ns, {position.x(), position.y(), position.z()}};
  return path;
}

TEST(DeviceFrame, ConservesWorkBetweenHandAndTip) {
  const Eigen::Quaterniond rotation{Eigen::AngleAxisd{0.7, Vec3d{1, 2, 3}.normalized()}};
  DeviceFrame frame{rotation, {1, 2, 3}, 2.5};
  DeviceState a;
  DeviceState b;
  a.position = {0.01, 0.02, 0.03};
  b.position = {0.02, -0.01, 0.05};
  const Vec3d displacement = frame.to_world(b, false).position - frame.to_world(a, false).position;
  EXPECT_NEAR(displacement.norm(), 2.5 * (b.position - a.position).norm(), 1e-12);
  const Vec3d force{3, -2, 1};
  EXPECT_NEAR(force.dot(displacement), frame.force_to_device(force).dot(b.position - a.position), 1e-12);
}

TEST(DeviceFrame, ScalesTheLimitsOfTheDevice) {
  const DeviceFrame frame{Eigen::Quaterniond::Identity(), Vec3d::Zero(), 4};
  const DeviceSpec world = frame.to_world(DeviceSpec{10, 4000, 3, 0.1});
  EXPECT_NEAR(frame.force_to_device({world.max_force, 0, 0}).norm(), 10, 1e-12);
  // A device displacement x makes a world force of 4 x * stiffness, and the device exerts 4 times this force.
  EXPECT_NEAR(frame.force_to_device({world.max_stiffness * 4, 0, 0}).norm(), 4000, 1e-9);
}

TEST(DeviceFrame, KeepsTheTipInPlaceWhileTheClutchIsDown) {
  DeviceFrame frame{Eigen::Quaterniond::Identity(), {0, 0, 1}, 2};
  DeviceState device;
  device.velocity = {1, 0, 0};
  device.position = {0.1, 0, 0};
  const Vec3d before = frame.to_world(device, false).position;
  for (int i = 1; i <= 3; ++i) {
    device.position.x() = 0.1 - 0.02 * i;
    const DeviceState world = frame.to_world(device, true);
    EXPECT_LT((world.position - before).norm(), 1e-12);
    EXPECT_EQ(world.velocity, Vec3d(Vec3d::Zero()));
    EXPECT_EQ(frame.force_to_device({1, 1, 1}), Vec3d(Vec3d::Zero()));
  }
  EXPECT_LT((frame.to_world(device, false).position - before).norm(), 1e-12);
  device.position.x() += 0.01;
  EXPECT_LT((frame.to_world(device, false).position - before - Vec3d(0.02, 0, 0)).norm(), 1e-12);
  EXPECT_NE(frame.force_to_device({1, 1, 1}), Vec3d(Vec3d::Zero()));
}

TEST(DeviceFrame, APositionThatIsNotFiniteLeavesTheTipWhereItWas) {
  DeviceState valid, invalid;
  valid.position = {0.1, 0, 0};
  for (const double number : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
    for (const bool clutched_before : {false, true}) {
      DeviceFrame frame{Eigen::Quaterniond::Identity(), {0, 0, 1}, 2};
      const Vec3d before = frame.to_world(valid, false).position;
      (void)frame.to_world(valid, clutched_before);
      invalid.position = {0, number, 0};
      EXPECT_FALSE(frame.to_world(invalid, clutched_before).position.allFinite())
          << "the force renderer latches a fault";
      EXPECT_EQ(frame.to_world(valid, true).position, before);
      EXPECT_EQ(frame.to_world(valid, false).position, before);
    }
}

TEST(HandPath, IsLinearBetweenWaypointsAndConstantBeforeAndAfterThem) {
  HandPath path;
  path.count = 3;
  path.waypoints[0] = {10 * kMs, {0, 0, 0}};
  path.waypoints[1] = {20 * kMs, {1, 0, 0}};
  path.waypoints[2] = {40 * kMs, {1, 4, 0}};
  Vec3d position;
  Vec3d velocity;
  path.at(0, position, velocity);
  EXPECT_EQ(position, Vec3d(0, 0, 0));
  EXPECT_EQ(velocity, Vec3d(0, 0, 0));
  path.at(15 * kMs, position, velocity);
  EXPECT_LT((position - Vec3d(0.5, 0, 0)).norm(), 1e-12);
  EXPECT_LT((velocity - Vec3d(100, 0, 0)).norm(), 1e-9);
  path.at(30 * kMs, position, velocity);
  EXPECT_LT((position - Vec3d(1, 2, 0)).norm(), 1e-12);
  path.at(99 * kMs, position, velocity);
  EXPECT_EQ(position, Vec3d(1, 4, 0));
  EXPECT_EQ(velocity, Vec3d(0, 0, 0));
}

TEST(SimulatedDevice, ComesToRestAtItsTarget) {
  SimulatedDevice device;
  device.paths().post(path_to({0.05, 0, -0.02}));
  DeviceState state;
  for (int ms = 0; ms <= 1500; ++ms) state = device.read(ms * kMs);
  EXPECT_LT((state.position - Vec3d(0.05, 0, -0.02)).norm(), 1e-6);
  EXPECT_LT(state.velocity.norm(), 1e-5);
}

TEST(HandPath, RotatesUniformlyBetweenWaypoints) {
  HandPath path;
  path.count = 2;
  path.waypoints[0] = {10 * kMs, {0, 0, 0}};
  path.waypoints[1] = {20 * kMs, {0, 0, 0}, {0, 0, std::sin(0.4), std::cos(0.4)}};
  EXPECT_EQ(path.orientation_at(0).angularDistance(Eigen::Quaterniond::Identity()), 0);
  const Eigen::Quaterniond half{Eigen::AngleAxisd{0.4, Vec3d::UnitZ()}};
  EXPECT_LT(path.orientation_at(15 * kMs).angularDistance(half), 1e-12);
  EXPECT_LT(path.orientation_at(99 * kMs).angularDistance(half * half), 1e-12);
}

TEST(SimulatedDevice, RotatesWithTheWristAndYieldsToATorque) {
  HandSettings settings;
  SimulatedDevice device{settings};
  HandPath path = path_to(Vec3d::Zero());
  path.waypoints[0].orientation = {std::sin(0.3), 0, 0, std::cos(0.3)};
  device.paths().post(path);
  const Eigen::Quaterniond target{Eigen::AngleAxisd{0.6, Vec3d::UnitX()}};
  DeviceState state;
  double max_angle = 0;
  for (int ms = 0; ms <= 500; ++ms) {
    state = device.read(ms * kMs);
    max_angle = std::max(max_angle, state.orientation.angularDistance(Eigen::Quaterniond::Identity()));
  }
  EXPECT_LT(state.orientation.angularDistance(target), 1e-6);
  EXPECT_LT(max_angle, 0.6 * 1.1);
  const Vec3d torque{0, 0.02, 0};
  device.write_wrench(Vec3d::Zero(), torque);
  for (int ms = 501; ms <= 1500; ++ms) state = device.read(ms * kMs);
  const Eigen::Quaterniond deflection{Eigen::AngleAxisd{0.02 / settings.wrist_stiffness, Vec3d::UnitY()}};
  EXPECT_LT(state.orientation.angularDistance(deflection * target), 1e-6);
}

TEST(SimulatedDevice, YieldsToAForceAccordingToTheStiffnessOfTheHand) {
  HandSettings settings;
  SimulatedDevice device{settings};
  device.write({0, 0, 2});
  DeviceState state;
  for (int ms = 0; ms <= 1500; ++ms) state = device.read(ms * kMs);
  EXPECT_NEAR(state.position.z(), 2 / settings.hand_stiffness, 1e-6);
}

TEST(SimulatedDevice, OscillatesAtTheFrequencyOfItsMassAndSpring) {
  // The oracle is the closed form of a damped oscillator that is released 10 mm from its equilibrium.
  HandSettings settings;
  settings.start = {0.01, 0, 0};
  const DeviceSpec spec;
  SimulatedDevice device{settings, spec};
  device.paths().post(path_to({0, 0, 0}));
  const double decay = (spec.damping + settings.hand_damping) / (2 * settings.mass);
  const double frequency = std::sqrt(settings.hand_stiffness / settings.mass - decay * decay);
  for (int ms = 0; ms <= 300; ++ms) {
    const double t = ms * kCycle;
    const double expected =
        0.01 * std::exp(-decay * t) * (std::cos(frequency * t) + decay / frequency * std::sin(frequency * t));
    ASSERT_NEAR(device.read(ms * kMs).position.x(), expected, 1e-4) << ms << " ms";
  }
}

TEST(SimulatedDevice, GivesEqualPositionsForEqualSeeds) {
  HandSettings settings;
  settings.tremor = 5e-4;
  settings.noise = 1e-5;
  SimulatedDevice a{settings};
  SimulatedDevice b{settings};
  settings.seed = 2;
  SimulatedDevice c{settings};
  bool differs = false;
  double sum_of_squares = 0;
  for (int ms = 0; ms < 2000; ++ms) {
    const Vec3d position = a.read(ms * kMs).position;
    ASSERT_EQ(position, b.read(ms * kMs).position);
    differs = differs || position != c.read(ms * kMs).position;
    sum_of_squares += position.squaredNorm();
  }
  EXPECT_TRUE(differs);
  EXPECT_GT(std::sqrt(sum_of_squares / 2000), 5e-5);
  EXPECT_LT(std::sqrt(sum_of_squares / 2000), 1e-3);
}

TEST(SimulatedDevice, ReadsInWholeEncoderSteps) {
  HandSettings settings;
  settings.encoder_step = 5e-5;
  SimulatedDevice device{settings};
  device.paths().post(path_to({0.01234, 0, 0}));
  for (int ms = 0; ms < 500; ++ms) {
    const double steps = device.read(ms * kMs).position.x() / 5e-5;
    ASSERT_NEAR(steps, std::round(steps), 1e-6);
  }
}

TEST(SimulatedDevice, RestsOnAFloorWithoutLimitCycle) {
  // Closes the loop of device, proxy and force at the maximum allowed stiffness: a tap at 0.3 m/s, then rest.
  testing::TriangleSurface surface{testing::square(1, 0)};
  HandSettings settings;
  settings.start = {0, 0, 0.05};
  SimulatedDevice device{settings};
  ForceSettings limits;
  limits.soft_start = 0;
  ForceRenderer renderer{limits, device.spec()};
  const ContactImpedance impedance{1e6, 0};
  Proxy proxy;
  proxy.set_grip({0, 0});
  HandPath path;
  path.count = 2;
  path.waypoints[0] = {0, {0, 0, 0.05}};
  path.waypoints[1] = {200 * kMs, {0, 0, -0.01}};
  device.paths().post(path);
  double late_speed = 0;
  double force = 0;
  for (int ms = 0; ms < 3000; ++ms) {
    const DeviceState state = device.read(ms * kMs);
    const ProxyResult& touch = proxy.step(state.position, kCycle, surface, false);
    force = renderer.step(touch, state, impedance, 0, kCycle).force.z();
    device.write({0, 0, force});
    if (ms > 2500) late_speed = std::max(late_speed, state.velocity.norm());
  }
  EXPECT_LT(late_speed, 1e-4);
  // Hand and wall are two springs in series.
  const double wall_stiffness = renderer.stiffness(impedance, kCycle);
  const double combined_stiffness = 1 / (1 / settings.hand_stiffness + 1 / wall_stiffness);
  EXPECT_NEAR(force, combined_stiffness * (0.01 + ProxySettings{}.radius), 0.01);
}

class ReplayFile : public ::testing::Test {
 protected:
  ~ReplayFile() override { std::remove(path_.c_str()); }
  std::string write(const std::string& text) {
    std::ofstream{path_} << text;
    return path_;
  }
  std::string open_error(const std::string& text) {
    try {
      ReplayDevice device{write(text)};
    } catch (const DeviceError& error) {
      return error.what();
    }
    return "";
  }
  std::string path_ = ::testing::TempDir() + "tactus_replay_test.csv";
};

TEST_F(ReplayFile, InterpolatesItsPosesFromTheFirstReadOnAndThenEnds) {
  ReplayDevice device{write("time_s,x,y,z\n# a comment\n5,0,0,0\n5.1,0.01,0,0\n\n5.2,0.01,0.02,0\r\n")};
  EXPECT_EQ(device.size(), 3u);
  EXPECT_EQ(device.read(1000 * kMs).position, Vec3d(0, 0, 0));
  const DeviceState state = device.read(1050 * kMs);
  EXPECT_LT((state.position - Vec3d(0.005, 0, 0)).norm(), 1e-9);
  EXPECT_LT((state.velocity - Vec3d(0.1, 0, 0)).norm(), 1e-9);
  EXPECT_EQ(device.health(), DeviceHealth::kReady);
  EXPECT_EQ(device.read(1300 * kMs).position, Vec3d(0.01, 0.02, 0));
  EXPECT_EQ(device.health(), DeviceHealth::kEnded);
}

TEST_F(ReplayFile, AnErrorNamesTheFileTheLineAndTheFoundText) {
  EXPECT_THAT(open_error("0,0,0,0\n1,2,x,3\n"), HasSubstr(".csv:2: found '1,2,x,3', expected 'time_s,x,y,z'"));
  EXPECT_THAT(open_error("0,0,0\n"), HasSubstr(":1: found '0,0,0'"));
  EXPECT_THAT(open_error("0,0,0,0,0\n"), HasSubstr(":1: found"));
  EXPECT_THAT(open_error("0,0,0,nan\n"), HasSubstr(":1: found"));
  EXPECT_THAT(open_error("0,0,0,0\n0,1,0,0\n"), HasSubstr(":2: time 0.000000 s is not after"));
  EXPECT_THAT(open_error("time_s,x,y,z\n"), HasSubstr("found no pose"));
  EXPECT_THROW(ReplayDevice{"/nowhere/at/all.csv"}, DeviceError);
}

}  // namespace
}  // namespace tactus::haptics
