#include "hrtc_service/servo/probe_devices.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <random>

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kPeriodNs = 1'000'000;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

class ProbeDevicesTest : public testing::Test {
 protected:
  void read() { devices_.read(now_ns_ += kPeriodNs, inputs_); }
  void read(int cycles) {
    for (int cycle = 0; cycle < cycles; ++cycle) read();
  }
  void order(const ProbeOrder& order) {
    ProbeOrders orders{};
    orders[1] = order;
    MailboxWriter{link_.orders}.post(orders);
  }
  void send_path(std::uint64_t user, const std::array<double, 3>& position) {
    UserPath path{user, {}};
    path.path.waypoints[path.path.count++] = {now_ns_, position};
    MailboxWriter{link_.paths[1]}.post(path);
  }
  [[nodiscard]] haptics::TimedPose pose_at(double x) const {
    haptics::TimedPose timed;
    timed.pose.position = {x, 0, 0};
    timed.pose.sequence = 7;
    timed.pose.measured_ns = now_ns_ - 2 * kPeriodNs;
    timed.pose.arrived_ns = now_ns_;
    return timed;
  }
  void send_pose(std::uint64_t user, const haptics::TimedPose& pose) {
    MailboxWriter{link_.poses[1]}.post({user, pose});
  }
  [[nodiscard]] const ProbeInput& input() const { return inputs_[1]; }
  [[nodiscard]] double x() const { return input().device.position.x(); }

  std::int64_t now_ns_ = 1'000'000'000;
  DeviceLink link_;
  haptics::SimulatedDevice local_{{.start = {0.5, 0, 0}}};
  ProbeDevices devices_{link_, {&local_}, haptics::DeviceFrame{Eigen::Quaterniond::Identity(), {0, 0, 1}, 1}};
  std::array<ProbeInput, kMaxProbes> inputs_;
};

TEST_F(ProbeDevicesTest, AProbeWithALocalDeviceAlwaysHasIt) {
  ProbeOrders orders{};
  orders[0] = {.source = PoseSource::kRemote, .user = 3};
  MailboxWriter{link_.orders}.post(orders);
  read();
  EXPECT_TRUE(inputs_[0].active);
  EXPECT_TRUE(inputs_[0].device.position.isApprox(Vec3d{0.5, 0, 1})) << "in the world frame";
  for (std::uint32_t i = 1; i < kMaxProbes; ++i) EXPECT_FALSE(inputs_[i].active);
}

/// A device at this machine, whose state a test sets.
class LocalDevice final : public haptics::Device {
 public:
  [[nodiscard]] const haptics::DeviceSpec& spec() const noexcept override { return spec_; }
  [[nodiscard]] haptics::DeviceState read(std::int64_t now_ns) noexcept override {
    state.time_ns = now_ns;
    return state;
  }
  void write(const Vec3d& force) noexcept override { written = force; }
  [[nodiscard]] haptics::DeviceHealth health() const noexcept override { return haptics::DeviceHealth::kReady; }

  haptics::DeviceState state;
  Vec3d written = Vec3d::Zero();

 private:
  haptics::DeviceSpec spec_;
};

/// A device at this machine on which a force in the world acts.
class LocalDeviceTest : public testing::TestWithParam<double> {
 protected:
  void step(double force) {
    outputs_[0].force = {force, 0, 0};
    devices_.read(now_ns_ += kPeriodNs, inputs_);
    devices_.write(outputs_);
    max_change_ = std::max(max_change_, (device_.written - before_).norm());
    before_ = device_.written;
  }

  std::int64_t now_ns_ = 1'000'000'000;
  DeviceLink link_;
  LocalDevice device_;
  const HandLimits limits_{};
  ProbeDevices devices_{
      link_, {&device_}, haptics::DeviceFrame{Eigen::Quaterniond::Identity(), Vec3d::Zero(), GetParam()}, limits_};
  std::array<ProbeInput, kMaxProbes> inputs_;
  std::array<ProbeOutput, kMaxProbes> outputs_{};
  Vec3d before_ = Vec3d::Zero();
  double max_change_ = 0;
};

TEST_P(LocalDeviceTest, TheForceRisesWithinATenthOfASecondAfterTheClutch) {
  const double force = limits_.max_force / GetParam();
  for (int cycle = 0; cycle < 10; ++cycle) step(force);
  ASSERT_NEAR(device_.written.x(), limits_.max_force, 1e-9);
  device_.state.buttons = haptics::kClutchButton;
  for (int cycle = 0; cycle < 10; ++cycle) step(force);
  EXPECT_EQ(device_.written.norm(), 0);
  device_.state.buttons = 0;
  max_change_ = 0;
  for (int cycle = 0; cycle < 50; ++cycle) step(force);
  EXPECT_NEAR(device_.written.x(), limits_.max_force / 2, 0.1);
  for (int cycle = 0; cycle < 60; ++cycle) step(force);
  EXPECT_NEAR(device_.written.x(), limits_.max_force, 1e-9);
  EXPECT_LT(max_change_, 0.1);
}

TEST_P(LocalDeviceTest, TheForceAtTheHandHasTheLimitsOfTheHrtc) {
  const double sign[] = {1, 1, 1, -1, -1, -1};
  for (int cycle = 0; cycle < 60; ++cycle) {
    step(5 * sign[cycle / 2 % 6] * (1 + cycle % 2));  // N, changes by at most 15 N in the world
    ASSERT_LE(device_.written.norm(), limits_.max_force + 1e-9);
  }
  if (GetParam() > 1) {
    EXPECT_LE(max_change_, limits_.max_slew * limits_.period + 1e-9);
  }
  outputs_[0].status = session::kFault;
  step(0);
  EXPECT_EQ(device_.written.norm(), 0) << "a fault ends the force at once";
  for (const double wrong : {kNan, std::numeric_limits<double>::infinity()}) {
    step(wrong);
    EXPECT_EQ(device_.written.norm(), 0) << "in the world: " << wrong << " N";
  }
}

TEST_P(LocalDeviceTest, ALimitThatIsNaNMakesTheForceZero) {
  HandLimits no_force, no_slew;
  no_force.max_force = kNan;
  no_slew.max_slew = kNan;
  for (const HandLimits& limits : {no_force, no_slew}) {
    if (GetParam() <= 1 && std::isnan(limits.max_slew)) continue;  // the renderer limits the slew
    const auto link = std::make_unique<DeviceLink>();
    ProbeDevices devices{
        *link, {&device_}, haptics::DeviceFrame{Eigen::Quaterniond::Identity(), Vec3d::Zero(), GetParam()}, limits};
    outputs_[0].force = {1, 0, 0};
    devices.read(now_ns_, inputs_);
    devices.write(outputs_);
    EXPECT_EQ(device_.written.norm(), 0);
  }
}

// With a larger scale, the renderer sees the speed in the world.
TEST_P(LocalDeviceTest, ADeviceOfASmallScaleThatIsFasterThanAHandHasFailedWhileAForceActs) {
  device_.state.velocity = {2 * limits_.max_speed, 0, 0};
  step(0);
  step(0);
  EXPECT_FALSE(inputs_[0].failed);
  step(1);
  step(1);
  EXPECT_EQ(inputs_[0].failed, GetParam() < 1);
}

INSTANTIATE_TEST_SUITE_P(Scales, LocalDeviceTest, testing::Values(0.1, 1, 3));

TEST_F(ProbeDevicesTest, AHandFollowsItsPathAndFeelsTheForce) {
  order({.source = PoseSource::kHand, .user = 1, .start = {0.1, 0, 0}});
  read();
  EXPECT_TRUE(input().active);
  EXPECT_DOUBLE_EQ(x(), 0.1);
  send_path(1, {0.2, 0, 0});
  read(1000);
  EXPECT_NEAR(x(), 0.2, 0.001);

  std::array<ProbeOutput, kMaxProbes> outputs{};
  outputs[1].force = {2, 0, 0};
  for (int cycle = 0; cycle < 1000; ++cycle) {
    devices_.write(outputs);
    read();
  }
  EXPECT_NEAR(x(), 0.2 + 2.0 / haptics::HandSettings{}.hand_stiffness, 0.001);
}

TEST_F(ProbeDevicesTest, APathThatArrivesBeforeTheOrderForItsUserIsKept) {
  send_path(1, {0.2, 0, 0});
  read();
  order({.source = PoseSource::kHand, .user = 1});
  read(1000);
  EXPECT_NEAR(x(), 0.2, 0.001);
}

TEST_F(ProbeDevicesTest, ALaterUserDoesNotGetThePathOrThePoseOfAnEarlierOne) {
  order({.source = PoseSource::kHand, .user = 1});
  send_path(1, {0.2, 0, 0});
  read(1000);
  order({.source = PoseSource::kHand, .user = 2, .start = {0.1, 0, 0}});
  read(1000);
  EXPECT_NEAR(x(), 0.1, 0.001);

  order({.source = PoseSource::kRemote, .user = 3});
  send_pose(3, pose_at(0.3));
  read(2);
  EXPECT_DOUBLE_EQ(x(), 0.3);
  order({.source = PoseSource::kRemote, .user = 4});
  read(2);
  EXPECT_FALSE(input().active) << "no pose of this user has arrived";
}

// The cycle resets the proxy and the force of a probe that is inactive.
TEST_F(ProbeDevicesTest, AProbeIsInactiveOnceBetweenTwoUsersAlsoIfTheServoWasSuspendedMeanwhile) {
  order({.source = PoseSource::kRemote, .user = 1});
  send_pose(1, pose_at(0.3));
  read();
  ASSERT_TRUE(input().active);
  order({});
  order({.source = PoseSource::kRemote, .user = 2});
  send_pose(2, pose_at(0.1));
  read();
  EXPECT_FALSE(input().active);
  read();
  EXPECT_TRUE(input().active);
  EXPECT_DOUBLE_EQ(x(), 0.1);

  order({.source = PoseSource::kHand, .user = 3});
  read();
  EXPECT_FALSE(input().active);
  read();
  EXPECT_TRUE(input().active);
  order({});
  read();
  order({.source = PoseSource::kHand, .user = 4});
  read();
  EXPECT_TRUE(input().active) << "the probe was inactive before";
}

TEST_F(ProbeDevicesTest, ARemotePoseHasItsAgeAndTransit) {
  order({.source = PoseSource::kRemote, .user = 1});
  send_pose(1, pose_at(0.3));
  read(5);
  EXPECT_TRUE(input().active);
  EXPECT_EQ(input().device.sequence, 7u);
  EXPECT_NEAR(input().pose_age, 7e-3, 1e-9);
  EXPECT_NEAR(input().device.transit, 2e-3, 1e-9);
}

TEST_F(ProbeDevicesTest, WrongOrdersPathsAndPosesAreIgnored) {
  order({.source = PoseSource::kHand, .user = 1});
  read();
  send_path(1, {kNan, 0, 0});
  read();
  EXPECT_EQ(x(), 0);
  UserPath long_path{1, {}};
  long_path.path.count = 1000;
  MailboxWriter{link_.paths[1]}.post(long_path);
  read(10);
  EXPECT_EQ(x(), 0);

  order({.source = PoseSource::kHand, .user = 2, .start = {1e300, 0, 0}});
  read();
  EXPECT_FALSE(input().active);
  order({.source = static_cast<PoseSource>(77), .user = 3});
  read();
  EXPECT_FALSE(input().active);

  order({.source = PoseSource::kRemote, .user = 4});
  send_pose(4, pose_at(0.3));
  read();
  haptics::TimedPose wrong[] = {pose_at(kNan), pose_at(0.4), pose_at(0.4), pose_at(0.4)};
  wrong[1].pose.orientation = {0, 0, 0, 0};
  wrong[2].pose.measured_ns = std::numeric_limits<std::int64_t>::min();
  wrong[3].round_trip = -1;
  for (const haptics::TimedPose& pose : wrong) {
    send_pose(4, pose);
    read();
    EXPECT_DOUBLE_EQ(x(), 0.3);
  }
}

// Any bits in the link give finite states. The sanitizers check the accesses.
TEST_F(ProbeDevicesTest, AnyBitsInTheLinkGiveFiniteStates) {
  std::mt19937_64 random{20261126};
  int active = 0;
  for (int step = 0; step < 20000; ++step) {
    ProbeOrder random_order{.source = static_cast<PoseSource>(random() % 4), .user = random() % 3};
    if (random() % 4 == 0) random_order.start[random() % 3] = std::bit_cast<double>(random());
    order(random_order);
    UserPath path{random() % 3, {}};
    path.path.count = static_cast<std::uint32_t>(random() % 3 == 0 ? random() : 1 + random() % 16);
    for (haptics::HandPath::Waypoint& waypoint : path.path.waypoints) {
      waypoint.time_ns = now_ns_ + static_cast<std::int64_t>(random() % (200 * kPeriodNs));
      if (random() % 64 == 0) waypoint.position[random() % 3] = std::bit_cast<double>(random());
    }
    MailboxWriter{link_.paths[1]}.post(path);
    haptics::TimedPose pose = pose_at(0.1);
    auto* const bytes = reinterpret_cast<unsigned char*>(&pose);
    if (random() % 2 == 0) bytes[random() % sizeof pose] ^= static_cast<unsigned char>(1u << random() % 8);
    send_pose(random() % 3, pose);
    if (random() % 5 == 0) link_.orders.posted = random();
    if (random() % 5 == 0) link_.paths[1].posted = random();
    read();
    if (!input().active) read();  // between two users the probe is inactive once
    if (!input().active) continue;
    ++active;
    ASSERT_TRUE(input().device.position.allFinite()) << "step " << step;
    ASSERT_TRUE(input().device.velocity.allFinite()) << "step " << step;
    ASSERT_TRUE(input().device.orientation.coeffs().allFinite()) << "step " << step;
  }
  EXPECT_GT(active, 5000);
}

}  // namespace
}  // namespace tactus::hrtc_service
