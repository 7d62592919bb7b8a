// Users who come and go at an HRTC, over DDS as in a session.

#include "hrtc_service/seats.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <string>
#include <thread>

#include "hrtc_service/realtime.hpp"

namespace tactus::hrtc_service {
namespace {

wire::SessionAddress address(const std::string& participant) {
  wire::SessionAddress made;
  made.session = "test.seats." + std::to_string(getpid());
  made.participant = participant;
  made.domain = 50 + 3 * (static_cast<int>(getpid()) % 13);
  return made;
}

session::RosterEntry client_with(const std::string& user, const wire::Links& links) {
  session::RosterEntry entry;
  entry.origin = links.origin();
  entry.role = session::Role::kClient;
  entry.name = links.address().participant;
  entry.users = {user};
  return entry;
}

/// A sender that uses what it was last given until it looks again, and a haptic thread of its own.
class SeatsTest : public testing::Test {
 protected:
  SeatsTest() {
    HapticSettings settings;
    settings.priority = 0;
    haptic_.emplace(settings, std::array<haptics::DeviceSpec, kMaxProbes>{});
    orders_.emplace(*haptic_);
    seats_.emplace(links_, kMaxProbes, *orders_, [](session::Intent&&) {});
    (void)haptic_->start();
  }
  ~SeatsTest() override { haptic_->stop(); }

  /// Until the user's first pose has arrived and its device is in use.
  void open_device(const std::string& user) {
    wire::Writer<session::DevicePose> poses{client_, wire::topics::kDevicePose,
                                            wire::EndOptions{wire::user_partition(user)}};
    session::DevicePose pose;
    pose.user_id = session::id_of(user);
    while (orders_->now().devices[0] == nullptr) {  // the watchdog is ctest's
      pose.origin = client_.origin();
      ++pose.sequence;
      (void)poses.send(pose);
      seats_->open_remote_devices();
      std::this_thread::yield();
    }
  }

  wire::Links links_{address("hrtc")};
  wire::Links client_{address("client")};
  std::optional<HapticThread> haptic_;
  std::optional<HapticOrders> orders_;
  std::optional<Seats> seats_;
};

TEST_F(SeatsTest, WhatUsersBringIsFreedAfterTheyHaveLeft) {
  ProbeReports report;
  for (int round = 0; round < 10; ++round) {
    const std::string user = "user " + std::to_string(round);
    seats_->seat(client_with(user, client_));
    open_device(user);
    report.probes[0].active = true;
    seats_->send_commands(report);
    ASSERT_EQ(seats_->unseat(client_.origin().participant, user), session::id_of(user));
    while (seats_->left() > 0) {
      seats_->send_commands(report);
      seats_->free_left();
      std::this_thread::yield();
    }
  }
  for (int round = 0; round < 20; ++round) {  // users without a device, of which no sender knows
    const std::string user = "hand " + std::to_string(round);
    seats_->seat(client_with(user, client_));
    ASSERT_TRUE(seats_->unseat(client_.origin().participant, user));
  }
  while (seats_->left() > 0) seats_->free_left();
  EXPECT_TRUE(seats_->slots().empty());
}

TEST_F(SeatsTest, AWriterIsNotDestroyedWhereTheSenderCouldMeetIt) {
  seats_->seat(client_with("ann", client_));
  open_device("ann");
  ProbeReports report;
  report.probes[0].active = true;
  seats_->send_commands(report);
  const std::uint64_t without = orders_->now().number + 1;
  ASSERT_TRUE(seats_->unseat(client_.origin().participant, "ann"));
  while (!orders_->obeyed(without)) std::this_thread::yield();
  seats_->free_left();

  EXPECT_EQ(seats_->left(), 1u) << "the sender may be about to send its last command";
  seats_->send_commands(report);
  seats_->free_left();
  EXPECT_EQ(seats_->left(), 0u);
}

TEST(Handover, ThingsLiveUntilTheUserHasLetGoOfThem) {
  Handover<std::array<int*, 2>> handover;
  Retired<std::unique_ptr<int>> retired;
  auto thing = std::make_unique<int>(7);
  handover.post({thing.get(), nullptr});
  const std::array<int*, 2>& in_use = handover.latest();
  retired.add(handover.post({}), std::move(thing));
  const auto collect = [&] { retired.collect([&](std::uint64_t number) { return handover.passed(number); }); };
  collect();

  EXPECT_EQ(retired.size(), 1u);
  EXPECT_EQ(*in_use[0], 7);
  EXPECT_EQ(handover.latest()[0], nullptr);
  collect();
  EXPECT_EQ(retired.size(), 0u);
}

}  // namespace
}  // namespace tactus::hrtc_service
