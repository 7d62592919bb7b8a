// Writers of users who have left an HRTC are freed, but not while the sender may use them.

#include "hrtc_service/user_devices.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <string>
#include <thread>

#include "hrtc_service/servo/probe_devices.hpp"
#include "realtime/periodic_clock.hpp"
#include "tests/support/test_domain.hpp"

namespace tactus::hrtc_service {
namespace {

wire::SessionAddress address(const std::string& participant) {
  wire::SessionAddress address;
  address.session = "test.user_devices." + std::to_string(getpid());
  address.participant = participant;
  address.domain = test_support::test_domain();
  return address;
}

/// The test's thread is the sender: after a call of send_commands, its writers count as in use until the next call.
class UserDevicesTest : public testing::Test {
 protected:
  /// Publishes poses of the user until the servo has the order to use its device. The timeout of ctest limits the wait.
  void open_device(const std::string& user) {
    wire::Writer<session::DevicePose> poses{client_, wire::topics::kDevicePose,
                                            wire::EndpointOptions{wire::user_partition(user)}};
    session::DevicePose pose;
    pose.user_id = session::id_of(user);
    while (devices_.orders()[0].source != PoseSource::kRemote) {
      pose.origin = client_.origin();
      ++pose.sequence;
      (void)poses.send(pose);
      devices_.open_remote_devices();
      std::this_thread::yield();
    }
  }

  wire::Participants participants_{address("hrtc")};
  wire::Participants client_{address("client")};
  DeviceLink link_;
  UserDevices devices_{participants_, link_, [](session::Intent&&) {}};
};

TEST_F(UserDevicesTest, WritersAreFreedAfterTheirUsersHaveLeft) {
  ProbeReports report;
  for (int round = 0; round < 10; ++round) {
    const std::string user = "user " + std::to_string(round);
    devices_.add(0, user, client_.origin().participant);
    open_device(user);
    report.probes[0].active = true;
    devices_.send_commands(report);
    devices_.remove(0);
    while (devices_.departed_count() > 0) {
      devices_.send_commands(report);
      devices_.free_departed();
      std::this_thread::yield();
    }
  }
  for (int round = 0; round < 20; ++round) {  // users without a device, for whom nothing is sent
    const std::string user = "hand " + std::to_string(round);
    devices_.add(0, user, client_.origin().participant);
    devices_.remove(0);
  }
  while (devices_.departed_count() > 0) devices_.free_departed();
  EXPECT_EQ(devices_.user_at(0), 0u);
}

TEST_F(UserDevicesTest, TheServoReadsThePosesOfAClientsDevice) {
  ProbeDevices probes{link_, {}, haptics::DeviceFrame{}};
  std::array<ProbeInput, kMaxProbes> inputs;
  devices_.add(0, "ann", client_.origin().participant);
  probes.read(realtime::monotonic_ns(), inputs);
  EXPECT_FALSE(inputs[0].active) << "no pose has arrived";
  open_device("ann");
  while (!inputs[0].active) probes.read(realtime::monotonic_ns(), inputs);
  EXPECT_GT(inputs[0].device.sequence, 0u);
  devices_.remove(0);
  probes.read(realtime::monotonic_ns(), inputs);
  EXPECT_FALSE(inputs[0].active);
}

TEST_F(UserDevicesTest, AWriterIsNotDestroyedWhileTheSenderMayUseIt) {
  devices_.add(0, "ann", client_.origin().participant);
  open_device("ann");
  ProbeReports report;
  report.probes[0].active = true;
  devices_.send_commands(report);
  devices_.remove(0);
  devices_.free_departed();

  EXPECT_EQ(devices_.departed_count(), 1u) << "the sender may still use the writer";
  devices_.send_commands(report);
  devices_.free_departed();
  EXPECT_EQ(devices_.departed_count(), 0u);
}

TEST_F(UserDevicesTest, AHandContinuesUnderAnotherGateway) {
  ProbeDevices probes{link_, {}, haptics::DeviceFrame{}};
  std::array<ProbeInput, kMaxProbes> inputs;
  const std::uint64_t client = client_.origin().participant;
  const auto move_to = [&](UserDevices& devices, double x) {
    session::Intent intent;
    intent.user_id = session::id_of("ann");
    intent.origin = client_.origin();
    intent.path.resize(1);
    intent.path[0].pose.position = {x, 0, 0};
    devices.on_intent(intent, 0);
  };
  std::int64_t now_ns = realtime::monotonic_ns();
  const auto x_after = [&](int cycles) {
    for (int cycle = 0; cycle < cycles; ++cycle) probes.read(now_ns += 1'000'000, inputs);
    return inputs[1].device.position.x();
  };
  devices_.add(1, "ann", client);
  move_to(devices_, 0);
  (void)x_after(1);
  move_to(devices_, 0.1);
  const double before = x_after(500);
  ASSERT_GT(before, 0.01);

  UserDevices second{participants_, link_, [](session::Intent&&) {}};
  EXPECT_EQ(UserDevices::users_in(link_)[1], session::id_of("ann"));
  EXPECT_NEAR(x_after(1), before, 2e-3) << "without its user";
  second.add(1, "ann", client);
  EXPECT_NEAR(x_after(1), before, 4e-3);
  EXPECT_TRUE(inputs[1].active);
  second.remove_earlier_users();
  move_to(second, -0.1);
  EXPECT_LT(x_after(2000), -0.05);

  UserDevices third{participants_, link_, [](session::Intent&&) {}};
  third.remove_earlier_users();
  (void)x_after(1);
  EXPECT_FALSE(inputs[1].active) << "its user has not come back";
}

TEST(Handover, AnObjectLivesUntilTheOtherThreadHasTakenALaterList) {
  Handover<std::array<int*, 2>> handover;
  DeferredDestruction<std::unique_ptr<int>> deferred;
  auto value = std::make_unique<int>(7);
  handover.post({value.get(), nullptr});
  const std::array<int*, 2>& in_use = handover.latest();
  deferred.add(handover.post({}), std::move(value));
  const auto collect = [&] { deferred.collect([&](std::uint64_t number) { return handover.is_adopted(number); }); };
  collect();

  EXPECT_EQ(deferred.size(), 1u);
  EXPECT_EQ(*in_use[0], 7);
  EXPECT_EQ(handover.latest()[0], nullptr);
  collect();
  EXPECT_EQ(deferred.size(), 0u);
}

}  // namespace
}  // namespace tactus::hrtc_service
