#include "haptics/remote_device.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <memory>
#include <random>
#include <utility>

#include "haptics/force.hpp"
#include "haptics/simulated_device.hpp"
#include "tests/support/constants.hpp"

namespace tactus::haptics {
namespace {

RemotePose pose(std::uint32_t sequence, double x, std::int64_t arrived_ns, std::uint32_t applied_command = 0) {
  RemotePose result;
  result.sequence = sequence;
  result.position = {x, 0, 0};
  result.measured_ns = result.arrived_ns = arrived_ns;
  result.command_applied = applied_command;
  return result;
}

TEST(RemoteDevice, ShowsTheNewestPose) {
  RemoteDevice device;
  device.on_pose(pose(6, 0.6, 0));
  device.on_pose(pose(7, 0.7, kMs));
  const DeviceState state = device.read(3 * kMs);
  EXPECT_EQ(state.position.x(), 0.7);
  EXPECT_EQ(state.sequence, 7u);
  EXPECT_EQ(state.time_ns, kMs);
}

TEST(RemoteDevice, BoundsTheTransitWhenAClockIsWrong) {
  RemoteDevice device;
  RemotePose sent = pose(1, 0, 50 * kMs);
  for (const std::int64_t taken :
       {std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max()}) {
    ++sent.sequence;
    sent.measured_ns = taken;
    device.on_pose(sent);
    EXPECT_GE(device.read(51 * kMs).transit, 0);
    EXPECT_LE(device.read(51 * kMs).transit, 10);
  }
}

TEST(RemoteDevice, DistinguishesTransitFromSilence) {
  RemoteDevice device;
  RemotePose sent = pose(1, 0, 50 * kMs);
  sent.measured_ns = 20 * kMs;
  device.on_pose(sent);
  const DeviceState state = device.read(58 * kMs);
  EXPECT_EQ(state.time_ns, 20 * kMs);
  EXPECT_NEAR(state.transit, 0.030, 1e-12);
  // A wrong clock does not give a pose a time in the future.
  sent.sequence = 2;
  sent.measured_ns = 90 * kMs;
  device.on_pose(sent);
  EXPECT_EQ(device.read(58 * kMs).transit, 0);
}

TEST(RemoteDevice, MeasuresTheRoundTripByTheAgeOfTheAppliedCommand) {
  RemoteDevice device;
  EXPECT_EQ(device.round_trip(), RoundTripBound::kUnknown);
  for (std::uint32_t i = 1; i <= 3000; ++i) {
    EXPECT_EQ(device.on_command(i * kMs), i);
    device.on_pose(pose(i, 0, i * kMs, i > 20 ? i - 20 : 0));
  }
  EXPECT_NEAR(device.round_trip(), 0.020, 0.005);
  EXPECT_EQ(device.read(0).round_trip, device.round_trip());
}

TEST(RemoteDevice, ADeviceWithoutNewCommandsHasALongRoundTrip) {
  RemoteDevice device;
  for (std::uint32_t i = 1; i <= 1000; ++i) {
    (void)device.on_command(i * kMs);
    device.on_pose(pose(i, 0, i * kMs, std::min(i, 500u)));
  }
  EXPECT_GT(device.round_trip(), 0.45);
}

TEST(RemoteDevice, IgnoresACommandNumberThatWasNeverSent) {
  RemoteDevice device;
  (void)device.on_command(kMs);
  device.on_pose(pose(1, 0, 2 * kMs, 99));
  EXPECT_EQ(device.round_trip(), RoundTripBound::kUnknown);
}

TEST(RoundTripBound, FollowsARiseWithin50MsAndAFallWithATimeConstantOf1S) {
  constexpr double kShort = 0.002, kLong = 0.05;  // s
  RoundTripBound delay;
  const auto measure = [&](double seconds, int count) {
    for (int i = 0; i < count; ++i) delay.add(seconds, kCycle);
    return delay.value();
  };
  EXPECT_NEAR(measure(kShort, 5000), kShort, 1e-4);
  EXPECT_GT(measure(kLong, 50), kShort + (1 - std::exp(-1.0)) * (kLong - kShort));
  EXPECT_NEAR(measure(kLong, 5000), kLong, 1e-3);
  const double before = measure(kShort, 100);  // meanwhile mean and deviation settle after the jump
  EXPECT_NEAR(measure(kShort, 1000) - kShort, (before - kShort) * std::exp(-1.0), 1e-5);
  EXPECT_NEAR(measure(kShort, 5000), kShort, 1e-3);
}

/// A hand pressed against a wall at x = 0 over a link with delay, jitter and loss, in steps of 1 ms.
class PressedHand {
 public:
  PressedHand(double one_way, double jitter, double loss) : one_way_{one_way}, jitter_{jitter}, loss_{loss} {
    HandSettings settings;
    settings.start = {0.005, 0, 0};
    hand_ = std::make_unique<SimulatedDevice>(settings);
    HandPath path;
    path.count = 1;
    path.waypoints[0] = {0, {-0.005, 0, 0}};
    hand_->paths().post(path);
  }

  /// Simulates `seconds` and returns the maximum speed of the hand in the last second, m/s.
  double run(double seconds, bool with_stiffness_cut) {
    double max_speed = 0;
    for (std::int64_t ms = 1; ms <= std::lround(seconds * 1000); ++ms) {
      const std::int64_t now = ms * kMs;
      while (!commands_.empty() && commands_.front().arrival_ns <= now) {
        if (commands_.front().number > applied_command_) {
          applied_command_ = commands_.front().number;
          hand_->write({commands_.front().force, 0, 0});
        }
        commands_.pop_front();
      }
      const DeviceState hand_state = hand_->read(now);
      RemotePose hand_pose = pose(static_cast<std::uint32_t>(ms), hand_state.position.x(), 0, applied_command_);
      hand_pose.velocity = {hand_state.velocity.x(), 0, 0};
      hand_pose.measured_ns = now;
      if (arrives()) poses_.push_back({now + one_way_delay(), hand_pose});
      while (!poses_.empty() && poses_.front().arrival_ns <= now) {
        poses_.front().pose.arrived_ns = now;
        device_.on_pose(poses_.front().pose);
        poses_.pop_front();
      }
      DeviceState state = device_.read(now);
      if (!with_stiffness_cut) state.round_trip = 0;
      ProxyResult proxy;
      proxy.normal = Vec3d::UnitX();
      proxy.in_contact = state.position.x() < 0;
      proxy.anchor = proxy.in_contact ? Vec3d::Zero() : state.position;
      const double age = static_cast<double>(now - state.time_ns) * 1e-9 - state.transit;
      const ForceResult& force = renderer_.step(proxy, state, ContactImpedance{1000, 1}, age, kCycle);
      const std::uint32_t number = device_.on_command(now);
      if (arrives()) commands_.push_back({now + one_way_delay(), number, force.force.x()});
      if (ms > std::lround(seconds * 1000) - 1000) max_speed = std::max(max_speed, hand_state.velocity.norm());
    }
    return max_speed;
  }
  [[nodiscard]] double round_trip() const { return device_.round_trip(); }

 private:
  struct DelayedPose {
    std::int64_t arrival_ns;
    RemotePose pose;
  };
  struct DelayedCommand {
    std::int64_t arrival_ns;
    std::uint32_t number;
    double force;  // N, along x
  };

  [[nodiscard]] bool arrives() { return std::uniform_real_distribution<>{}(random_) >= loss_; }
  /// The queues preserve the order, so a sample with a shorter delay waits for the samples before it.
  [[nodiscard]] std::int64_t one_way_delay() {
    const double seconds = one_way_ + std::abs(std::normal_distribution<>{0, 1}(random_)) * jitter_;
    return std::llround(seconds * 1e9);
  }

  double one_way_, jitter_, loss_;
  std::mt19937 random_{7};
  std::unique_ptr<SimulatedDevice> hand_;
  RemoteDevice device_;
  ForceRenderer renderer_{{}, {}};
  std::deque<DelayedPose> poses_;
  std::deque<DelayedCommand> commands_;
  std::uint32_t applied_command_ = 0;
};

TEST(RemoteDevice, AHandPressedToAWallRestsForAnyDelayJitterAndLoss) {
  for (const double one_way : {0.0005, 0.005, 0.02, 0.06, 0.1})
    for (const auto& [jitter, loss] : {std::pair{0.0, 0.0}, std::pair{0.2, 0.0}, std::pair{0.1, 0.2}}) {
      PressedHand hand{one_way, jitter * one_way, loss};
      // Jitter makes the force fluctuate, so the hand still moves slowly. An unstable hand reaches 50 mm/s.
      EXPECT_LT(hand.run(12, true), 3e-3) << one_way << " s, jitter " << jitter << ", loss " << loss
                                          << ", round trip estimated at " << hand.round_trip() << " s";
    }
}

TEST(RemoteDevice, WithoutTheStiffnessCutAPressedHandIsUnstable) {
  PressedHand hand{0.02, 0, 0};
  EXPECT_GT(hand.run(12, false), 0.05);
}

TEST(RemoteDevice, AShortRoundTripKeepsTheStiffnessOfTheMaterial) {
  PressedHand hand{0.0003, 0, 0};
  (void)hand.run(12, true);
  ForceRenderer renderer{{}, {}};
  EXPECT_EQ(renderer.stiffness(ContactImpedance{1000, 1}, kCycle, hand.round_trip()), 1000) << hand.round_trip();
}

}  // namespace
}  // namespace tactus::haptics
