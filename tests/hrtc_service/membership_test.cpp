#include "hrtc_service/membership.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "hrtc_service/hrtc_core.hpp"
#include "tests/support/constants.hpp"

namespace tactus::hrtc_service {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr std::uint64_t kClient = 40;

/// Gives an HRTC the roster entries of programs that are all named "client".
class MembershipOfClients : public ::testing::Test {
 protected:
  struct Program {
    std::uint64_t incarnation;
    std::vector<std::string> users;
    std::uint64_t heartbeat = 0;
  };

  void send(Program& program, bool leaving = false) {
    session::RosterEntry entry;
    entry.origin = {kSession, kClient, program.incarnation, 0};
    entry.role = session::Role::kClient;
    entry.name = "client";
    entry.requested_hrtc = "hrtc";
    entry.users = program.users;
    entry.heartbeat = ++program.heartbeat;
    entry.leaving = leaving;
    membership_.on_roster(entry, now_);
    note_changes();
  }
  /// Lets time pass. The programs send heartbeats.
  void run(std::int64_t duration_ms, const std::vector<Program*>& programs) {
    for (std::int64_t ms = 0; ms < duration_ms; ms += 50) {
      now_ += 50 * kMs;
      for (Program* const program : programs) send(*program);
      membership_.tick(now_);
      note_changes();
    }
  }
  [[nodiscard]] std::vector<std::string> users() const {
    std::vector<std::string> names;
    for (std::uint32_t probe = 0; probe < kMaxProbes; ++probe)
      if (membership_.has_user(probe)) names.push_back(membership_.name_at(probe));
    return names;
  }

  std::vector<std::string> left_;  // users who have lost their probe

 private:
  void note_changes() {
    for (const UserChange& change : membership_.output.users)
      if (!change.joined) left_.push_back(change.name);
    membership_.output.clear();
  }
  static HrtcCoreSettings core_settings() {
    HrtcCoreSettings settings;
    settings.pool = {64, 64, 64, 64};
    return settings;
  }

  std::int64_t now_ = 1000 * kMs;
  HrtcCore core_{session::Origin{kSession, kHrtc, 1, 0}, core_settings()};

 protected:
  Membership membership_{session::Origin{kSession, kHrtc, 1, 0}, {"hrtc", "session", 2}, core_.gateway(), now_};
};

TEST_F(MembershipOfClients, AUserWhomARestartedClientNoLongerNamesLosesItsProbe) {
  Program before{1, {"ann"}}, after{2, {"bob"}};
  run(200, {&before});
  run(1000, {&after});
  EXPECT_THAT(users(), ElementsAre("bob"));
  EXPECT_THAT(left_, ElementsAre("ann"));
}

TEST_F(MembershipOfClients, NoUserRemainsAfterARestartedClientHasEnded) {
  for (const bool sends_leave_message : {false, true}) {
    Program before{sends_leave_message ? 11u : 1u, {"ann"}}, after{before.incarnation + 1, {"bob"}};
    run(200, {&before});
    send(after);
    if (sends_leave_message) send(after, true);
    run(1000, {});
    EXPECT_THAT(users(), IsEmpty()) << sends_leave_message;
  }
}

TEST_F(MembershipOfClients, ALeaveMessageWithoutUsersFreesTheProbesAtOnce) {
  Program client{1, {"ann", "bob"}};
  run(200, {&client});
  client.users.clear();
  send(client, true);
  EXPECT_THAT(users(), IsEmpty());
}

TEST_F(MembershipOfClients, AUserKeepsItsProbeDuringANameConflict) {
  Program client{1, {"ann"}}, rival{2, {"bob"}};
  run(200, {&client});
  run(2000, {&client, &rival});
  EXPECT_THAT(users(), ElementsAre("ann", "bob"));
  send(rival, true);
  run(2000, {&client});
  EXPECT_THAT(users(), ElementsAre("ann"));
  EXPECT_THAT(left_, ElementsAre("bob"));
}

TEST_F(MembershipOfClients, ARefusedUserGetsTheProbeOfAUserOfTheProgramBefore) {
  Program before{1, {"ann", "ben"}}, after{2, {"bob", "cid"}};
  run(200, {&before});
  run(1000, {&after});
  EXPECT_THAT(users(), ElementsAre("bob", "cid"));
}

}  // namespace
}  // namespace tactus::hrtc_service
