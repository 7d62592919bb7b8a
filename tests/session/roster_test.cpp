#include "session/roster.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

RosterEntry entry(const std::string& name, std::uint64_t incarnation, std::uint64_t heartbeat) {
  RosterEntry result;
  result.origin = {kSession, id_of(name), incarnation, 0};
  result.role = Role::kHrtc;
  result.name = name;
  result.heartbeat = heartbeat;
  return result;
}

std::vector<RosterChange> changes(const std::vector<RosterEvent>& events) {
  std::vector<RosterChange> result;
  for (const RosterEvent& event : events) result.push_back(event.change);
  return result;
}

class RosterTest : public testing::Test {
 protected:
  std::vector<RosterChange> receive(const RosterEntry& received, std::int64_t now) {
    return changes(roster_.on_entry(received, now));
  }

  /// Ticks every 10 ms, as programs do.
  std::vector<RosterChange> tick_until(std::int64_t end_ns) {
    std::vector<RosterChange> all;
    for (; ticked_ns_ < end_ns; ticked_ns_ = std::min(ticked_ns_ + 10 * kMs, end_ns))
      for (const RosterChange change : changes(roster_.tick(ticked_ns_))) all.push_back(change);
    for (const RosterChange change : changes(roster_.tick(end_ns))) all.push_back(change);
    return all;
  }

  Roster roster_{{kSession, id_of("me"), 50, 0}, RosterSettings{}};
  std::int64_t ticked_ns_ = 0;
};

TEST_F(RosterTest, ReportsASilentParticipantAsLateThenAsGone) {
  EXPECT_THAT(receive(entry("a", 1, 1), 0), ElementsAre(RosterChange::kJoined));
  EXPECT_THAT(tick_until(249 * kMs), IsEmpty());
  const std::vector<RosterEvent> late = roster_.tick(250 * kMs);
  ASSERT_THAT(changes(late), ElementsAre(RosterChange::kLate));
  EXPECT_THAT(text(late[0]), HasSubstr("'a' has sent no heartbeat for 250 ms"));
  EXPECT_TRUE(roster_.is_late(id_of("a")));
  EXPECT_THAT(changes(roster_.tick(260 * kMs)), IsEmpty()) << "a late participant is reported once";
  EXPECT_THAT(receive(entry("a", 1, 2), 300 * kMs), ElementsAre(RosterChange::kRecovered));
  EXPECT_THAT(tick_until(800 * kMs), ElementsAre(RosterChange::kLate, RosterChange::kGone));
  EXPECT_EQ(roster_.find(id_of("a")), nullptr);
  EXPECT_THAT(receive(entry("a", 1, 3), 900 * kMs), ElementsAre(RosterChange::kJoined))
      << "the same incarnation after a partition of the network";
}

TEST_F(RosterTest, TheTimeInWhichThisProgramWasSuspendedIsNoSilenceOfTheOthers) {
  EXPECT_THAT(receive(entry("a", 1, 1), 0), ElementsAre(RosterChange::kJoined));
  EXPECT_THAT(receive(entry("b", 1, 1), 0), ElementsAre(RosterChange::kJoined));
  EXPECT_THAT(tick_until(100 * kMs), IsEmpty());
  ticked_ns_ = 5000 * kMs;  // it was suspended in between
  EXPECT_THAT(tick_until(5010 * kMs), IsEmpty());
  EXPECT_THAT(receive(entry("a", 1, 30), 5010 * kMs), IsEmpty());
  EXPECT_THAT(tick_until(5480 * kMs), ElementsAre(RosterChange::kLate, RosterChange::kLate, RosterChange::kGone))
      << "b has not sent anything since";
  EXPECT_NE(roster_.find(id_of("a")), nullptr);
  EXPECT_EQ(roster_.find(id_of("b")), nullptr);
}

TEST_F(RosterTest, AParticipantThatLeftJoinsAgainOnlyAfterARestart) {
  (void)receive(entry("a", 1, 1), 0);
  RosterEntry leaving = entry("a", 1, 3);
  leaving.leaving = true;
  EXPECT_THAT(receive(leaving, 10), ElementsAre(RosterChange::kLeft));
  EXPECT_THAT(receive(entry("a", 1, 2), 20), IsEmpty()) << "a delayed sample";
  EXPECT_THAT(receive(entry("a", 2, 1), 30), ElementsAre(RosterChange::kJoined));
}

TEST_F(RosterTest, ReportsAnotherProtocolVersionOnceAndNamesBoth) {
  RosterEntry other = entry("a", 1, 1);
  other.protocol = kProtocolVersion + 4;

  const std::vector<RosterEvent> events = roster_.on_entry(other, 0);

  ASSERT_THAT(changes(events), ElementsAre(RosterChange::kWrongVersion));
  EXPECT_THAT(text(events[0]),
              AllOf(HasSubstr("'a'"), HasSubstr("found protocol version " + std::to_string(kProtocolVersion + 4)),
                    HasSubstr("expected " + std::to_string(kProtocolVersion))));
  EXPECT_THAT(roster_.on_entry(other, 1), IsEmpty());
  EXPECT_EQ(roster_.find(id_of("a")), nullptr);
}

TEST_F(RosterTest, IgnoresOtherSessions) {
  RosterEntry other = entry("a", 1, 1);
  other.origin.session = 2;
  EXPECT_THAT(receive(other, 0), IsEmpty());
  EXPECT_THAT(roster_.entries(), IsEmpty());
}

TEST_F(RosterTest, ANewerIncarnationReplacesTheOlderAndDelayedSamplesAreIgnored) {
  (void)receive(entry("a", 1, 7), 0);
  EXPECT_THAT(receive(entry("a", 2, 1), 10), ElementsAre(RosterChange::kRestarted));
  EXPECT_THAT(receive(entry("a", 1, 8), 20), IsEmpty()) << "a sample from before the restart";
  EXPECT_EQ(roster_.find(id_of("a"))->origin.incarnation, 2u);
}

TEST_F(RosterTest, ANameConflictIsReportedOnceAndNamesBothPrograms) {
  (void)receive(entry("a", 1, 7), 0);
  (void)receive(entry("a", 2, 1), 10);
  std::vector<RosterEvent> events;
  for (std::uint64_t beat = 8; beat < 20; ++beat) {
    for (RosterEvent& event : roster_.on_entry(entry("a", 1, beat), 20)) events.push_back(event);
    (void)receive(entry("a", 2, beat), 20);
  }
  ASSERT_THAT(changes(events), ElementsAre(RosterChange::kNameConflict));
  EXPECT_EQ(events[0].entry.origin.incarnation, 2u);
  EXPECT_EQ(events[0].other, 1u);
  EXPECT_THAT(text(events[0]), HasSubstr("incarnations 2 and 1"));
  EXPECT_EQ(severity(events[0]), Severity::kWarning);
}

TEST_F(RosterTest, OfTwoProgramsWithOneNameTheOlderReturnsWhenTheNewerLeaves) {
  (void)receive(entry("a", 1, 5), 0);
  (void)receive(entry("a", 2, 1), 0);
  RosterEntry leaving = entry("a", 2, 2);
  leaving.leaving = true;
  ASSERT_THAT(receive(leaving, 0), ElementsAre(RosterChange::kLeft));
  EXPECT_THAT(receive(entry("a", 1, 6), 1), IsEmpty()) << "may be a delayed sample";
  EXPECT_THAT(receive(entry("a", 1, 7), 2), IsEmpty());
  EXPECT_THAT(receive(entry("a", 1, 8), 3), ElementsAre(RosterChange::kJoined));
  EXPECT_EQ(roster_.find(id_of("a"))->origin.incarnation, 1u);
  EXPECT_THAT(receive(entry("a", 1, 9), 4), IsEmpty());
}

TEST_F(RosterTest, AnotherProgramWithTheNameOfThisProgramIsReported) {
  EXPECT_THAT(receive(entry("me", 50, 1), 0), IsEmpty()) << "this program itself";
  EXPECT_THAT(receive(entry("me", 40, 9), 0), IsEmpty()) << "may be a delayed sample of an earlier incarnation";
  EXPECT_THAT(receive(entry("me", 40, 10), 0), IsEmpty());
  EXPECT_THAT(receive(entry("me", 40, 11), 0), ElementsAre(RosterChange::kNameConflict));
}

TEST_F(RosterTest, ReportsAChangeOfUsers) {
  (void)receive(entry("a", 1, 1), 0);
  RosterEntry changed = entry("a", 1, 2);
  changed.served_users = {{"ann", 0}};
  EXPECT_THAT(receive(changed, 1), ElementsAre(RosterChange::kChanged));
  changed.heartbeat = 3;
  EXPECT_THAT(receive(changed, 2), IsEmpty());
}

TEST_F(RosterTest, RefusesMoreThanTheMaxParticipants) {
  for (std::size_t i = 0; i < kMaxParticipants; ++i) (void)receive(entry("p" + std::to_string(i), 1, 1), 0);
  EXPECT_THAT(receive(entry("surplus", 1, 1), 0), ElementsAre(RosterChange::kFull));
  EXPECT_EQ(roster_.entries().size(), kMaxParticipants);
  (void)tick_until(1000 * kMs);
  EXPECT_THAT(receive(entry("surplus", 2, 1), 1000 * kMs), ElementsAre(RosterChange::kJoined));
}

TEST_F(RosterTest, ParticipantsThatLeftLongAgoAreDropped) {
  for (std::uint64_t i = 0; i < 500; ++i) {
    const std::int64_t now_ns = static_cast<std::int64_t>(i) * 1000 * kMs;
    RosterEntry client = entry("client " + std::to_string(i), 1, 1);
    (void)receive(client, now_ns);
    client.heartbeat = 2;
    client.leaving = i % 2 == 0;  // the other clients only become silent
    (void)receive(client, now_ns + kMs);
    (void)tick_until(now_ns + 600 * kMs);
    ASSERT_LE(roster_.stored_participants(), 12u);
  }
}

TEST_F(RosterTest, EachFurtherNameConflictIsReported) {
  for (std::uint64_t incarnation = 100; incarnation < 120; ++incarnation) {
    const std::int64_t now_ns = static_cast<std::int64_t>(incarnation) * 2000 * kMs;
    (void)tick_until(now_ns);
    EXPECT_THAT(receive(entry("me", incarnation, 9), now_ns), IsEmpty());
    EXPECT_THAT(receive(entry("me", incarnation, 10), now_ns), IsEmpty());
    EXPECT_THAT(receive(entry("me", incarnation, 11), now_ns), ElementsAre(RosterChange::kNameConflict)) << incarnation;
  }
}

TEST_F(RosterTest, TheProgramThatJoinedLaterLeavesWhateverItsIncarnation) {
  RosterEntry other = entry("me", 1, 8);  // smaller than 50, this program's incarnation, as from a wrong wall clock
  const auto this_program_leaves = [&](std::int64_t joined_ns, std::int64_t own_joined_ns) {
    Roster roster{{kSession, id_of("me"), 50, 0}, RosterSettings{}};
    roster.set_own_presence(3600'000 * kMs, own_joined_ns);
    other.session_time_ns = 3600'000 * kMs;
    other.joined_ns = joined_ns;
    std::vector<RosterEvent> events;
    for (int beat = 0; beat < 3; ++beat, ++other.heartbeat)
      for (RosterEvent& event : roster.on_entry(other, 0)) events.push_back(std::move(event));
    EXPECT_EQ(events.size(), 1u);
    return !events.empty() && events[0].change == RosterChange::kNameConflict && events[0].entry_must_leave;
  };
  EXPECT_FALSE(this_program_leaves(3599'000 * kMs, 1000 * kMs)) << "the other program joined an hour later";
  EXPECT_FALSE(this_program_leaves(kNotJoined, 1000 * kMs)) << "the other program has not joined yet";
  EXPECT_TRUE(this_program_leaves(1000 * kMs, 3599'000 * kMs));
  EXPECT_TRUE(this_program_leaves(1000 * kMs, kNotJoined));
  EXPECT_TRUE(this_program_leaves(1000 * kMs, 1500 * kMs))
      << "both joined at about the same time, so the incarnations decide";
}

TEST_F(RosterTest, SceneHashIsEqualForTheSameHostsAndHrtcs) {
  const Origin self{kSession, id_of("me"), 50, 0}, other{kSession, id_of("other"), 7, 0};
  Roster other_roster{other, RosterSettings{}};
  RosterEntry client = entry("client", 10, 1);
  client.role = Role::kClient;
  (void)receive(entry("other", 7, 1), 0);
  (void)receive(client, 0);
  EXPECT_NE(scene_hash(roster_, self, Role::kHrtc), scene_hash(other_roster, other, Role::kHrtc));
  (void)other_roster.on_entry(entry("me", 50, 1), 0);
  EXPECT_EQ(scene_hash(roster_, self, Role::kHrtc), scene_hash(other_roster, other, Role::kHrtc));
  (void)receive(entry("other", 8, 1), 0);
  EXPECT_NE(scene_hash(roster_, self, Role::kHrtc), scene_hash(other_roster, other, Role::kHrtc))
      << "a new incarnation";
}

TEST_F(RosterTest, AParticipantRemainsAfterOneImplausibleHeartbeat) {
  std::int64_t ms = 0;
  for (std::uint64_t beat = 1; beat < 40; ++beat) {
    (void)receive(entry("a", 1, beat), ms * kMs);
    if (beat == 10) (void)receive(entry("a", 1, UINT64_MAX), ms * kMs);
    EXPECT_THAT(changes(roster_.tick(ms * kMs)), IsEmpty()) << "at " << ms << " ms";
    ms += 100;
  }
}

TEST_F(RosterTest, TheOlderProgramReturnsDespiteOneImplausibleHeartbeat) {
  (void)receive(entry("a", 1, 5), 0);
  (void)receive(entry("a", 2, 1), 0);
  (void)receive(entry("a", 1, UINT64_MAX), 0);
  RosterEntry leaving = entry("a", 2, 2);
  leaving.leaving = true;
  ASSERT_THAT(receive(leaving, 0), ElementsAre(RosterChange::kLeft));
  for (std::uint64_t beat = 6; beat < 20; ++beat)
    (void)receive(entry("a", 1, beat), static_cast<std::int64_t>(beat) * kMs);
  ASSERT_NE(roster_.find(id_of("a")), nullptr);
  EXPECT_EQ(roster_.find(id_of("a"))->origin.incarnation, 1u);
}

TEST(UserTable, GrantEachUserOneSlotUpToTheCapacity) {
  UserTable served_users{2};
  EXPECT_EQ(served_users.grant("ann"), 0u);
  EXPECT_EQ(served_users.grant("bob"), 1u);
  EXPECT_EQ(served_users.grant("ann"), 0u);
  EXPECT_EQ(served_users.grant("cid"), std::nullopt);
  EXPECT_EQ(served_users.grant(""), std::nullopt);
  EXPECT_TRUE(served_users.release("ann"));
  EXPECT_FALSE(served_users.release("ann"));
  EXPECT_EQ(served_users.grant("cid"), 0u);
  EXPECT_EQ(served_users.list().size(), 2u);
  EXPECT_THROW(UserTable{kMaxUsers + 1}, std::invalid_argument);
}

TEST(UserTable, UsersKeepTheirNumbersOverARestart) {
  const std::vector<std::uint64_t> earlier{id_of("ann"), 0, id_of("bob"), id_of("cid")};
  UserTable served_users{4, earlier};
  EXPECT_EQ(served_users.grant("dan"), 1u) << "the only number that belonged to nobody";
  EXPECT_EQ(served_users.grant("bob"), 2u);
  EXPECT_EQ(served_users.grant("eve"), 0u) << "no other is free";
  EXPECT_EQ(served_users.grant("ann"), 3u);
  EXPECT_TRUE(served_users.release("bob"));
  EXPECT_EQ(served_users.grant("fay"), 2u) << "the number of a user who has left belongs to nobody";
}

}  // namespace
}  // namespace tactus::session
