// Emergency stops at an HRTC: the haptic thread runs while a tip presses on a sphere.

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

#include "haptics/simulated_device.hpp"
#include "host_service/host_core.hpp"
#include "hrtc_service/hrtc_core.hpp"
#include "hrtc_service/servo/haptic_thread.hpp"
#include "hrtc_service/stop_switch.hpp"
#include "realtime/periodic_clock.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "study/membership_exchange.hpp"
#include "tests/support/constants.hpp"

namespace tactus {
namespace {

using spm::Vec3d;

/// A simulated hand. The test reads the force that the haptic thread commands.
class ForceRecordingHand final : public haptics::Device {
 public:
  explicit ForceRecordingHand(const haptics::HandSettings& settings) : hand_{settings} {}
  [[nodiscard]] const haptics::DeviceSpec& spec() const noexcept override { return hand_.spec(); }
  [[nodiscard]] haptics::DeviceState read(std::int64_t now_ns) noexcept override {
    haptics::DeviceState state = hand_.read(now_ns);
    state.buttons |= pressed_;
    return state;
  }
  void write(const Vec3d& force) noexcept override {
    hand_.write(force);
    force_ = force.norm();
    writes_.fetch_add(1);
  }
  [[nodiscard]] haptics::DeviceHealth health() const noexcept override { return hand_.health(); }

  [[nodiscard]] double force() const noexcept { return force_; }
  [[nodiscard]] haptics::Mailbox<haptics::HandPath>& paths() noexcept { return hand_.paths(); }
  /// Presses these buttons and releases the others.
  void press(std::uint32_t buttons) noexcept { pressed_ = buttons; }
  /// Waits until the haptic thread has commanded `count` further forces.
  void wait_for_writes(std::uint64_t count) const {
    const std::uint64_t end = writes_ + count;
    while (writes_ < end) std::this_thread::yield();
  }

 private:
  haptics::SimulatedDevice hand_;
  std::atomic<double> force_{0};
  std::atomic<std::uint32_t> pressed_{0};
  std::atomic<std::uint64_t> writes_{0};
};

haptics::HandSettings hand_at(double x) {
  haptics::HandSettings hand;
  hand.start = {x, 0, 0};
  return hand;
}

/// An HRTC with the base mesh of a sphere, on which a tip presses.
class EmergencyStop : public ::testing::Test {
 protected:
  void SetUp() override {
    (void)haptic_.start();
    haptics::HandPath path;
    path.waypoints[path.count++] = {realtime::monotonic_ns(), {radius_ - 0.002, 0, 0}};
    hand_.paths().post(path);
    wait_for_force();
  }
  void TearDown() override { haptic_.stop(); }

  /// Lets host and HRTC exchange samples until the hand feels a force. The timeout of ctest limits the wait.
  void wait_for_force() {
    while (hand_.force() < 0.1) {
      const std::int64_t now = realtime::monotonic_ns();
      hrtc_service::Gateway& gateway = core_.gateway();
      gateway.tick(now, membership_.clock());
      membership_.tick(now);
      study::exchange_membership(host_, membership_, now);
      while (auto demand = gateway.demand(now)) host_.on_demand(*demand, now);
      while (auto chunk = host_.next_chunk(now)) gateway.on_chunk(chunk->chunk, now);
      core_.tick_intake();
      std::this_thread::yield();
    }
  }

  /// Resets the stop of this HRTC, which must be the only one. `number`: of the reset.
  void reset_own_stop(hrtc_service::StopSwitch& stops, std::uint32_t number) {
    std::vector<session::StopRecord> records;
    ASSERT_TRUE(stops.acknowledge(records));
    const std::vector<session::StopName> standing = session::standing_stops(records);
    ASSERT_EQ(standing.size(), 1u);
    EXPECT_EQ(standing[0].participant, kHrtc);
    EXPECT_TRUE(stops.on_reset({{kSession, 51, 1, 0}, number, standing, ""}));
    wait_for_force();
  }

  [[nodiscard]] hrtc_service::HrtcCoreSettings core_settings(const spm::Model& model) const {
    hrtc_service::HrtcCoreSettings settings;
    settings.pool = spm::PoolSettings::for_slots(model.summary.parts + 600);
    settings.servo.emergency_stop_signals = &signals_;
    return settings;
  }
  [[nodiscard]] static hrtc_service::HapticSettings haptic_settings() {
    hrtc_service::HapticSettings settings;
    settings.priority = 0;
    return settings;
  }

  std::atomic<std::uint32_t> signals_{0};  // a signal handler would increment it
  const spm::offline::BuiltModel built_ =
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kSphere, 2000));
  const spm::Model model_ = built_.model();
  const double radius_ = (model_.summary.bounds_max[0] - model_.summary.bounds_min[0]) / 2;
  ForceRecordingHand hand_{hand_at(radius_ + 0.02)};
  hrtc_service::HrtcCore core_{session::Origin{kSession, kHrtc, 1, 0}, core_settings(model_)};
  hrtc_service::Membership membership_{
      session::Origin{kSession, kHrtc, 1, 0}, {"hrtc", "session"}, core_.gateway(), realtime::monotonic_ns()};
  hrtc_service::HapticThread haptic_{haptic_settings(), core_.servo(), core_.link(), {&hand_}};
  const spm::codec::EncodedModel encoded_{model_};
  host_service::HostCore host_{session::Origin{kSession, kHost, 1, 0},
                               host_service::host_of("sphere", encoded_.compressed()), realtime::monotonic_ns()};
};

TEST_F(EmergencyStop, AStopAfterAResetInOneCycleZeroesTheForce) {
  core_.link().set_stop({false, 1});
  core_.link().set_stop({true, 1});

  hand_.wait_for_writes(2);  // the first write may belong to a cycle that began before the stop
  for (int cycle = 0; cycle < 1000; ++cycle) {
    ASSERT_EQ(hand_.force(), 0) << "in cycle " << cycle;
    hand_.wait_for_writes(1);
  }
}

TEST_F(EmergencyStop, TheCallbackOfAStopZeroesTheForceWithinACycleUntilAResetNamesTheStop) {
  hrtc_service::StopSwitch stops{session::Origin{kSession, kHrtc, 1, 0}, core_.link()};

  EXPECT_TRUE(stops.on_stop({50, 1, 1}));  // no queue and no other thread is between callback and haptic thread
  hand_.wait_for_writes(2);
  EXPECT_EQ(hand_.force(), 0);
  EXPECT_TRUE(stops.on_reset({{kSession, 51, 1, 0}, 1, {{60, 1, 1}}, ""}));
  hand_.wait_for_writes(100);
  EXPECT_EQ(hand_.force(), 0) << "the reset names another stop";
  EXPECT_TRUE(stops.on_reset({{kSession, 51, 1, 0}, 2, {{50, 1, 1}}, ""}));
  wait_for_force();
}

TEST_F(EmergencyStop, ASignalZeroesTheForceWithoutTheGatewayAndStandsUntilAResetNamesItsStop) {
  ++signals_;  // nothing but the haptic thread runs
  hand_.wait_for_writes(2);
  for (int cycle = 0; cycle < 100; ++cycle) {
    ASSERT_EQ(hand_.force(), 0) << "in cycle " << cycle;
    hand_.wait_for_writes(1);
  }

  hrtc_service::StopSwitch stops{session::Origin{kSession, kHrtc, 1, 0}, core_.link()};
  std::vector<session::StopRecord> records;
  EXPECT_TRUE(stops.on_reset({{kSession, 51, 1, 0}, 1, {{kHrtc, 1, 0}}, ""}));
  hand_.wait_for_writes(100);
  EXPECT_EQ(hand_.force(), 0) << "a reset before the gateway has issued the stop";
  EXPECT_FALSE(stops.acknowledge(records));

  EXPECT_TRUE(stops.issue_local_stop());
  EXPECT_FALSE(stops.issue_local_stop()) << "one stop for one signal";
  hand_.wait_for_writes(100);
  EXPECT_EQ(hand_.force(), 0);
  reset_own_stop(stops, 2);
}

TEST_F(EmergencyStop, AStopStandsUnderAnotherGatewayUntilAResetNamesItsStop) {
  std::uint32_t resets = 0;
  for (std::uint64_t incarnation = 1; incarnation <= 3; ++incarnation) {
    SCOPED_TRACE("gateway " + std::to_string(incarnation));
    {
      hrtc_service::StopSwitch stops{session::Origin{kSession, kHrtc, 2 * incarnation, 0}, core_.link()};
      EXPECT_FALSE(stops.stopped());
      EXPECT_TRUE(stops.on_stop({51, 1, static_cast<std::uint32_t>(incarnation)}));
      hand_.wait_for_writes(2);
      EXPECT_EQ(hand_.force(), 0);
    }
    hrtc_service::StopSwitch stops{session::Origin{kSession, kHrtc, 2 * incarnation + 1, 0}, core_.link()};
    EXPECT_TRUE(stops.stopped());
    hand_.wait_for_writes(100);
    EXPECT_EQ(hand_.force(), 0);
    ASSERT_NO_FATAL_FAILURE(reset_own_stop(stops, ++resets));
  }
}

TEST_F(EmergencyStop, AResetOfAnEarlierLocalStopDoesNotEndALaterOne) {
  hrtc_service::StopSwitch stops{session::Origin{kSession, kHrtc, 1, 0}, core_.link()};
  std::vector<session::StopRecord> records;
  ++signals_;
  hand_.wait_for_writes(2);  // the haptic thread counts the signals
  EXPECT_TRUE(stops.issue_local_stop());
  hand_.wait_for_writes(2);
  ASSERT_TRUE(stops.acknowledge(records));
  const std::vector<session::StopName> earlier = session::standing_stops(records);
  ++signals_;
  hand_.wait_for_writes(2);
  EXPECT_TRUE(stops.issue_local_stop());
  EXPECT_TRUE(stops.on_reset({{kSession, 51, 1, 0}, 1, earlier, ""}));
  hand_.wait_for_writes(100);
  EXPECT_EQ(hand_.force(), 0);
}

TEST_F(EmergencyStop, AStopButtonZeroesTheForceAndNoResetEndsItsStopWhileItIsPressed) {
  hrtc_service::StopSwitch stops{session::Origin{kSession, kHrtc, 1, 0}, core_.link()};
  auto reset = [&, number = 0u]() mutable {
    std::vector<session::StopRecord> records;
    (void)stops.acknowledge(records);
    (void)stops.on_reset({{kSession, 51, 1, 0}, ++number, session::standing_stops(records), ""});
    hand_.wait_for_writes(100);
  };
  hand_.press(haptics::kStopButton);
  hand_.wait_for_writes(2);
  EXPECT_EQ(hand_.force(), 0) << "before the gateway has issued a stop";
  EXPECT_TRUE(stops.issue_local_stop());
  hand_.wait_for_writes(100);

  reset();
  EXPECT_EQ(hand_.force(), 0) << "the button is still pressed";
  EXPECT_TRUE(stops.issue_local_stop()) << "a new stop after the reset";
  hand_.press(0);
  hand_.wait_for_writes(100);
  EXPECT_EQ(hand_.force(), 0) << "the new stop stands";

  reset();
  wait_for_force();
}

TEST_F(EmergencyStop, AStopInTheRosterEntryOfAPeerZeroesTheForce) {
  hrtc_service::StopSwitch stops{session::Origin{kSession, kHrtc, 1, 0}, core_.link()};
  session::RosterEntry peer;
  peer.origin = {kSession, kHost, 1, 0};
  peer.role = session::Role::kHost;
  peer.stops = {{50, 1, 1, 0, 0}};

  EXPECT_TRUE(stops.on_roster(peer));
  hand_.wait_for_writes(2);
  EXPECT_EQ(hand_.force(), 0);
}

TEST_F(EmergencyStop, AStopIsAcknowledgedOnlyAfterTheForceIsZero) {
  hrtc_service::StopSwitch stops{session::Origin{kSession, kHrtc, 1, 0}, core_.link()};
  std::vector<session::StopRecord> records;
  (void)stops.on_stop({50, 1, 1});

  while (!stops.acknowledge(records)) {
  }

  EXPECT_EQ(hand_.force(), 0);
  ASSERT_EQ(records.size(), 1u);
  EXPECT_EQ(records[0].stop, 1u);
  EXPECT_FALSE(stops.acknowledge(records)) << "no further stop was obeyed";
  haptic_.stop();
  (void)stops.on_reset({{kSession, 51, 1, 0}, 1, {{50, 1, 1}}, ""});
  EXPECT_FALSE(stops.acknowledge(records)) << "no cycle has obeyed the reset";
}

}  // namespace
}  // namespace tactus
