#include "session/stop_latch.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <map>
#include <random>
#include <tuple>
#include <variant>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;
using testing::SizeIs;

Origin origin(std::uint64_t participant, std::uint64_t incarnation = 1) {
  return {kSession, participant, incarnation, 0};
}
StopName stop(std::uint64_t participant, std::uint32_t number = 1, std::uint64_t incarnation = 1) {
  return {participant, incarnation, number};
}
ForceReset reset(std::uint64_t participant, std::uint32_t number, std::vector<StopName> stops) {
  return {origin(participant), number, std::move(stops), ""};
}
RosterEntry entry(std::uint64_t participant, const StopLatch& latch, std::uint64_t incarnation = 1) {
  RosterEntry result;
  result.origin = origin(participant, incarnation);
  result.role = Role::kHrtc;
  result.name = std::to_string(participant);
  result.stops = latch.records();
  return result;
}

TEST(StopLatch, StandsUntilAResetNamesIt) {
  StopLatch latch{origin(1)};
  EXPECT_FALSE(latch.stopped());
  EXPECT_TRUE(latch.on_stop(stop(2)));
  EXPECT_TRUE(latch.on_reset(reset(3, 1, {stop(4)}))) << "the reset names another stop";
  EXPECT_TRUE(latch.stopped());
  EXPECT_TRUE(latch.on_reset(reset(3, 2, {stop(2)})));
  EXPECT_FALSE(latch.stopped());
}

TEST(StopLatch, HoldsUntilEveryStopIsNamed) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(2));
  (void)latch.on_stop(stop(3));
  (void)latch.on_stop(stop(2, 1, 2));  // from a new incarnation of the issuer
  (void)latch.on_reset(reset(4, 1, {stop(2), stop(3)}));
  EXPECT_TRUE(latch.stopped());
  EXPECT_THAT(standing_stops(latch.records()), SizeIs(1));
  (void)latch.on_reset(reset(4, 2, {stop(2, 1, 2)}));
  EXPECT_FALSE(latch.stopped());
}

TEST(StopLatch, AResetThatArrivesBeforeItsStopEndsTheStopWhenItIsRepeated) {
  StopLatch latch{origin(1)};
  const ForceReset sent = reset(3, 1, {stop(2)});
  EXPECT_TRUE(latch.on_reset(sent));
  EXPECT_TRUE(latch.on_stop(stop(2)));
  EXPECT_FALSE(acknowledges(entry(1, latch), sent)) << "its sender has to repeat the reset";
  EXPECT_FALSE(latch.on_reset(sent));
  EXPECT_FALSE(latch.stopped());
  EXPECT_TRUE(acknowledges(entry(1, latch), sent));
  EXPECT_TRUE(latch.on_stop(stop(2, 2))) << "a later stop stands";
  EXPECT_TRUE(latch.stopped());
}

TEST(StopLatch, AResetEndsNoStopInAdvance) {
  for (const bool has_received_a_stop : {false, true}) {
    StopLatch latch{origin(1)}, peer{origin(5)};
    std::uint32_t number = 0;
    if (has_received_a_stop) (void)latch.on_stop(stop(2, ++number));
    (void)latch.on_reset(reset(3, 1, {stop(2, 0xffffffff)}));
    EXPECT_FALSE(latch.stopped()) << "a reset also ends the earlier stops of the issuer";
    EmergencyStop later;
    later.origin = origin(2);
    for (later.number = number + 1; later.number < number + 4; ++later.number) {
      EXPECT_FALSE(acknowledges(entry(1, latch), later));
      EXPECT_TRUE(latch.on_stop(later.name()));
      EXPECT_TRUE(latch.stopped());
      EXPECT_TRUE(acknowledges(entry(1, latch), later));
      EXPECT_TRUE(peer.on_roster(entry(1, latch))) << "other programs receive the stop from the roster too";
    }
  }
}

TEST(StopLatch, AStopIsAcknowledgedOnlyIfItStandsOrAResetHasEndedIt) {
  EmergencyStop sent;
  sent.origin = origin(2);
  sent.number = 3;
  RosterEntry peer = entry(1, StopLatch{origin(1)});
  const auto acknowledges_with = [&](std::uint32_t newest, std::uint32_t ended) {
    peer.stops = {{2, 1, newest, ended, 0}};
    return acknowledges(peer, sent);
  };
  EXPECT_FALSE(acknowledges_with(2, 2));
  EXPECT_TRUE(acknowledges_with(3, 2)) << "it stands";
  EXPECT_TRUE(acknowledges_with(3, 3));
  EXPECT_FALSE(acknowledges_with(4, 3)) << "not of the issuer, which repeats only its newest stop";
  EXPECT_FALSE(acknowledges_with(3, 0xffffffff)) << "the program had ended the stop before it received it";
}

TEST(StopLatch, ARepeatedSampleChangesNothing) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(2));
  EXPECT_FALSE(latch.on_stop(stop(2)));
  (void)latch.on_reset(reset(3, 1, {stop(2)}));
  EXPECT_EQ(latch.resets(), 1u);
  const std::uint64_t changes = latch.changes();
  EXPECT_FALSE(latch.on_reset(reset(3, 1, {stop(2)}))) << "a repeated reset would end a later device fault";
  EXPECT_FALSE(latch.on_stop(stop(2)));
  EXPECT_FALSE(latch.stopped());
  EXPECT_EQ(latch.resets(), 1u);
  EXPECT_EQ(latch.changes(), changes);
}

TEST(StopLatch, TwoReorderedResetsEndBothStops) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(2));
  (void)latch.on_stop(stop(3));
  (void)latch.on_reset(reset(4, 2, {stop(3)}));
  (void)latch.on_reset(reset(4, 1, {stop(2)}));
  EXPECT_FALSE(latch.stopped());
}

TEST(StopLatch, AppliesStopsFromTheRosterButNoResets) {
  StopLatch peer{origin(1)}, latch{origin(5)};
  (void)peer.on_stop(stop(2));
  EXPECT_TRUE(latch.on_roster(entry(1, peer)));
  EXPECT_TRUE(latch.stopped());
  EXPECT_FALSE(latch.on_roster(entry(1, peer)));
  (void)peer.on_reset(reset(3, 1, {stop(2)}));
  (void)latch.on_roster(entry(1, peer));
  EXPECT_TRUE(latch.stopped()) << "the sender of the roster entry may lack the right to reset";
  (void)latch.on_reset(reset(3, 1, {stop(2)}));
  EXPECT_FALSE(latch.stopped());
}

TEST(StopLatch, IgnoresRosterEntriesOfAnotherSessionOrProtocolVersion) {
  StopLatch peer{origin(1)}, latch{origin(5)};
  (void)peer.on_stop(stop(2));
  RosterEntry other = entry(1, peer);
  other.origin.session = kSession + 1;
  EXPECT_FALSE(latch.on_roster(other));
  other = entry(1, peer);
  other.protocol = kProtocolVersion + 1;
  EXPECT_FALSE(latch.on_roster(other));
  EXPECT_FALSE(latch.stopped());
}

bool has_record_of(const StopLatch& latch, std::uint64_t participant) {
  return std::any_of(latch.records().begin(), latch.records().end(),
                     [&](const StopRecord& record) { return record.participant == participant; });
}

/// Gives the latch a standing stop of each of `count` issuers, the first with id 100. Returns the names of the stops.
std::vector<StopName> issue_stops(StopLatch& latch, std::size_t count) {
  std::vector<StopName> names;
  for (std::uint64_t i = 0; i < count; ++i) names.push_back(stop(100 + i));
  for (const StopName& name : names) (void)latch.on_stop(name);
  return names;
}

TEST(StopLatch, DropsTheLeastRecentIssuerWithoutAStandingStopWhenFull) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(90));
  (void)latch.on_stop(stop(91));
  (void)latch.on_reset(reset(50, 1, {stop(90), stop(91)}));
  (void)latch.on_stop(stop(90));  // its issuer still repeats it
  (void)issue_stops(latch, kMaxStopIssuers - 2);
  EXPECT_THAT(latch.records(), SizeIs(kMaxStopIssuers + 1));
  EXPECT_TRUE(latch.on_stop(stop(300)));
  EXPECT_FALSE(has_record_of(latch, 91));
  EXPECT_TRUE(has_record_of(latch, 90));
  EXPECT_TRUE(has_record_of(latch, 50)) << "a repeated reset would count as new";
  EXPECT_TRUE(has_record_of(latch, 100));
  EXPECT_TRUE(has_record_of(latch, 300));
}

TEST(StopLatch, DropsTheLeastRecentIssuerOfAResetWhenFull) {
  StopLatch latch{origin(1)};
  for (std::uint64_t i = 0; i < kMaxResetIssuers; ++i) (void)latch.on_reset(reset(50 + i, 1, {}));
  EXPECT_FALSE(latch.on_reset(reset(50, 1, {}))) << "its sender still repeats it";
  EXPECT_TRUE(latch.on_reset(reset(90, 1, {})));
  EXPECT_THAT(latch.records(), SizeIs(kMaxResetIssuers));
  EXPECT_FALSE(has_record_of(latch, 51));
  EXPECT_TRUE(has_record_of(latch, 50));
}

TEST(StopLatch, AProgramThatIssuesStopsAndResetsLosesOnlyThePartThatIsDropped) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(50));
  (void)latch.on_reset(reset(50, 1, {stop(50)}));
  (void)issue_stops(latch, kMaxStopIssuers);
  EXPECT_FALSE(latch.on_reset(reset(50, 1, {})));
  for (std::uint64_t i = 0; i < kMaxResetIssuers; ++i) (void)latch.on_reset(reset(100 + i, 1, {}));
  EXPECT_THAT(standing_stops(latch.records()), SizeIs(kMaxStopIssuers));
}

TEST(StopLatch, IssuesItsOwnStopWhenNoRecordIsFree) {
  StopLatch latch{origin(1)};
  const std::vector<StopName> recorded = issue_stops(latch, kMaxStopIssuers);
  EXPECT_TRUE(latch.on_stop(stop(500)));
  EXPECT_FALSE(latch.on_stop(stop(500))) << "its own stop already stands";
  EXPECT_THAT(latch.records(), SizeIs(kMaxStopIssuers + 1));

  EmergencyStop unrecorded;
  unrecorded.origin = origin(500);
  unrecorded.number = 1;
  EXPECT_TRUE(acknowledges(entry(1, latch), unrecorded)) << "the sender need not repeat the stop";
  (void)latch.on_reset(reset(3, 1, recorded));
  EXPECT_TRUE(latch.stopped()) << "the reset does not name the stop without a record";
  ASSERT_THAT(standing_stops(latch.records()), SizeIs(1));
  EXPECT_EQ(standing_stops(latch.records())[0].participant, 1u);
  (void)latch.on_reset(reset(3, 2, standing_stops(latch.records())));
  EXPECT_FALSE(latch.stopped());

  for (const StopName& name : recorded) (void)latch.on_stop({name.participant, 1, 2});
  EXPECT_TRUE(latch.on_stop(stop(501))) << "the latch issues its own stop a second time";
  EXPECT_THAT(standing_stops(latch.records()), SizeIs(kMaxStopIssuers + 1));
}

TEST(StopLatch, ARepeatedResetOfAllRecordedStopsChangesNothing) {
  StopLatch latch{origin(1)};
  (void)issue_stops(latch, kMaxStopIssuers + 1);  // the last one makes the latch issue its own stop
  const ForceReset sent = reset(3, 1, standing_stops(latch.records()));
  EXPECT_TRUE(latch.on_reset(sent));
  EXPECT_FALSE(latch.stopped());
  EXPECT_TRUE(acknowledges(entry(1, latch), sent));
  const std::uint64_t changes = latch.changes();
  for (int i = 0; i < 3; ++i) {
    EXPECT_FALSE(latch.on_reset(sent)) << "a repeated reset would end a later device fault";
    EXPECT_TRUE(acknowledges(entry(1, latch), sent));
  }
  EXPECT_EQ(latch.resets(), 1u);
  EXPECT_EQ(latch.changes(), changes);
}

TEST(StopLatch, AResetThatNamesMoreUnknownStopsThanFitIsAppliedOnce) {
  StopLatch latch{origin(1)};
  (void)latch.on_stop(stop(700));
  std::vector<StopName> names;
  for (std::uint64_t i = 0; i < kMaxStops - 1; ++i) names.push_back(stop(100 + i));
  names.push_back(stop(700));
  const ForceReset sent = reset(3, 1, names);
  EXPECT_TRUE(latch.on_reset(sent));
  EXPECT_FALSE(latch.stopped());
  EXPECT_TRUE(acknowledges(entry(1, latch), sent));
  const std::uint64_t changes = latch.changes();
  EXPECT_FALSE(latch.on_reset(sent));
  EXPECT_EQ(latch.changes(), changes);
  EXPECT_LE(latch.records().size(), kMaxStops);
  // If a stop without a record arrives late, it stands, and the repeated reset ends it.
  const auto unrecorded = std::find_if(names.begin(), names.end(),
                                       [&](const StopName& name) { return !has_record_of(latch, name.participant); });
  ASSERT_NE(unrecorded, names.end());
  EXPECT_TRUE(latch.on_stop(*unrecorded));
  EXPECT_FALSE(acknowledges(entry(1, latch), sent)) << "its sender has to repeat the reset";
  EXPECT_FALSE(latch.on_reset(sent));
  EXPECT_FALSE(latch.stopped());
  EXPECT_TRUE(acknowledges(entry(1, latch), sent));
}

TEST(StopLatch, TwoSendersThatRepeatResetsOfManyStopsInTurnAreEachAppliedOnce) {
  StopLatch latch{origin(1)};
  std::vector<StopName> first_names, second_names;
  for (std::uint64_t i = 0; i < kMaxStopIssuers; ++i) first_names.push_back(stop(100 + i));
  for (std::uint64_t i = 0; i < kMaxStopIssuers; ++i) second_names.push_back(stop(200 + i));
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(latch.on_reset(reset(3, 1, first_names)), i == 0);
    EXPECT_EQ(latch.on_reset(reset(4, 1, second_names)), i == 0);
  }
  EXPECT_EQ(latch.resets(), 2u);
}

TEST(StopLatch, TheRosterOfAProgramWithoutTheResetDoesNotRenewTheStopsThatItEnded) {
  StopLatch latch{origin(1)}, peer{origin(5)};
  (void)issue_stops(peer, kMaxStopIssuers);
  (void)latch.on_roster(entry(5, peer));
  EXPECT_TRUE(latch.on_reset(reset(3, 1, standing_stops(peer.records()))));
  EXPECT_FALSE(latch.on_roster(entry(5, peer)));
  EXPECT_FALSE(latch.stopped());
}

// A member could state a stop that its issuer has not issued. After a reset of this stop, the issuer's own stops must
// still count, with a smaller number and with the same one.
TEST(StopLatch, AStopThatAnotherProgramStatedDoesNotReplaceThoseOfItsIssuer) {
  for (const std::uint32_t stated : {1u, 7u, 0xffffffffu}) {
    StopLatch latch{origin(1)}, liar{origin(5)};
    (void)liar.on_stop(stop(2, stated));
    EXPECT_TRUE(latch.on_roster(entry(5, liar)));
    (void)latch.on_reset(reset(3, 1, standing_stops(latch.records())));
    ASSERT_FALSE(latch.stopped());
    for (std::uint32_t number = 1; number <= 3; ++number) {
      EXPECT_TRUE(latch.on_stop(stop(2, number))) << stated << ", stop " << number;
      EXPECT_TRUE(latch.stopped()) << stated << ", stop " << number;
      EXPECT_FALSE(latch.on_stop(stop(2, number))) << "a repeated stop";
      (void)latch.on_reset(reset(3, 1 + number, standing_stops(latch.records())));
      EXPECT_FALSE(latch.stopped());
      EXPECT_FALSE(latch.on_stop(stop(2, number))) << "a repeated stop after its reset";
      EXPECT_FALSE(latch.stopped());
    }
  }
}

TEST(StopLatch, AResetOfAStopThatAnotherProgramStatedEndsNoStopOfItsIssuer) {
  StopLatch latch{origin(1)}, liar{origin(5)};
  (void)liar.on_stop(stop(2, 0xffffffff));
  (void)latch.on_roster(entry(5, liar));
  const ForceReset sent = reset(3, 1, standing_stops(latch.records()));
  EmergencyStop issued;
  issued.origin = origin(2);
  issued.number = 1;
  EXPECT_FALSE(acknowledges(entry(1, latch), issued)) << "it has not arrived";
  (void)latch.on_stop(issued.name());
  EXPECT_TRUE(acknowledges(entry(1, latch), issued));
  (void)latch.on_reset(sent);
  EXPECT_TRUE(latch.stopped());
}

TEST(StopLatch, AppliesNoStopsFromTheRosterOfAProgramThatRendersNoForceAndServesNoObject) {
  for (const Role role : {Role::kClient, Role::kViewer}) {
    StopLatch latch{origin(1)}, other{origin(5)};
    (void)other.on_stop(stop(2));
    RosterEntry stated = entry(5, other);
    stated.role = role;
    EXPECT_FALSE(latch.on_roster(stated));
    EXPECT_FALSE(latch.stopped());
  }
}

TEST(StopLatch, IgnoresStopsAndResetsUnderItsOwnName) {
  StopLatch latch{origin(1)};
  (void)latch.on_reset(reset(3, 1, {stop(1, 0xffffffff)}));
  EXPECT_FALSE(latch.on_stop(stop(1, 0xffffffff)));
  EXPECT_FALSE(latch.stopped());
  (void)issue_stops(latch, kMaxStops);
  EXPECT_THAT(standing_stops(latch.records()), SizeIs(kMaxStopIssuers + 1));
}

TEST(StopLatch, ListsTheProgramsThatHaveAndHaveNotAcknowledged) {
  Roster roster{origin(99), {}};
  std::map<std::uint64_t, StopLatch> latches;
  std::uint64_t heartbeat = 0;
  const auto publish_roster = [&] {
    ++heartbeat;
    for (const auto& [id, latch] : latches) {
      RosterEntry published = entry(id, latch);
      published.role = id == 1 ? Role::kHost : id == 4 ? Role::kClient : Role::kHrtc;
      published.heartbeat = heartbeat;
      (void)roster.on_entry(published, 0);
    }
  };
  for (const std::uint64_t id : {1, 2, 3, 4}) latches.try_emplace(id, origin(id));
  EmergencyStop sent_stop;
  sent_stop.origin = origin(99);
  sent_stop.number = 1;
  (void)latches.at(1).on_stop(sent_stop.name());
  (void)latches.at(2).on_stop(sent_stop.name());
  publish_roster();
  Acknowledgement result = acknowledgement(roster, sent_stop);
  EXPECT_THAT(result.hosts, ElementsAre("1"));
  EXPECT_THAT(result.hrtcs, ElementsAre("2"));
  EXPECT_THAT(result.missing, ElementsAre("3")) << "a client has no forces";

  const ForceReset sent_reset = reset(98, 1, {sent_stop.name()});
  (void)latches.at(2).on_reset(sent_reset);
  (void)latches.at(3).on_reset(sent_reset);
  publish_roster();
  result = acknowledgement(roster, sent_reset);
  EXPECT_THAT(result.hrtcs, ElementsAre("2", "3")) << "HRTC 3 has not received the stop";
  EXPECT_THAT(result.missing, ElementsAre("1"));
  EXPECT_THAT(acknowledgement(roster, sent_stop).missing, ElementsAre("3"));
  (void)latches.at(3).on_stop(sent_stop.name());
  publish_roster();
  EXPECT_THAT(acknowledgement(roster, sent_stop).missing, IsEmpty()) << "a stop that was reset also counts as received";
  EXPECT_THAT(acknowledgement(roster, sent_reset).missing, ElementsAre("1", "3")) << "the late stop stands at HRTC 3";
}

TEST(StopLatch, OfAProgramThatIsNeitherHostNorHrtcNoStopIsRead) {
  Roster roster{origin(99), {}};
  for (std::uint64_t id = 1; id <= 4; ++id) {
    RosterEntry listed = entry(id, StopLatch{origin(id)});
    listed.role = std::array{Role::kHost, Role::kHrtc, Role::kClient, Role::kViewer}[id - 1];
    listed.stops = {{50 + id, 1, 1, 0, 0}};
    (void)roster.on_entry(listed, 0);
  }
  const std::vector<StopName> stops = standing_stops(roster);
  ASSERT_THAT(stops, SizeIs(2));
  EXPECT_EQ(stops[0].participant, 51u);
  EXPECT_EQ(stops[1].participant, 52u);
}

/// The HRTCs 1 and 2, and a sender of a stop, which has number 99.
class RecipientsTest : public testing::Test {
 protected:
  RecipientsTest() {
    stop_.origin = origin(99);
    stop_.number = 1;
    publish({1, 2});
  }
  /// Sends the entries of these HRTCs, and then updates roster and recipients.
  void publish(const std::vector<std::uint64_t>& ids, bool leaving = false) {
    ++heartbeat_;
    now_ns_ += 50'000'000;
    for (const std::uint64_t id : ids) {
      RosterEntry sent = entry(id, latches_.try_emplace(id, origin(id)).first->second, incarnation_);
      sent.heartbeat = heartbeat_;
      sent.leaving = leaving;
      (void)roster_.on_entry(sent, now_ns_);
    }
    (void)roster_.tick(now_ns_);
    recipients_.update(roster_);
  }
  /// HRTC 1 acknowledges the stop and continues, HRTC 2 sends nothing for this number of heartbeats.
  void continue_without_2(int heartbeats) {
    (void)latches_.at(1).on_stop(stop_.name());
    for (int i = 0; i < heartbeats; ++i) publish({1});
  }
  [[nodiscard]] Acknowledgement acknowledgement() const { return recipients_.acknowledgement(stop_); }

  EmergencyStop stop_;
  Roster roster_{origin(99), {}};
  Recipients recipients_;
  std::map<std::uint64_t, StopLatch> latches_;
  std::uint64_t heartbeat_ = 0, incarnation_ = 1;
  std::int64_t now_ns_ = 0;
};

TEST_F(RecipientsTest, AnHrtcThatIsGoneIsMissingUntilItReturnsAndAcknowledges) {
  continue_without_2(300);  // longer than the roster stores an HRTC that is gone
  EXPECT_EQ(roster_.find(2), nullptr);
  EXPECT_EQ(roster_.stored_participants(), 1u);
  EXPECT_THAT(acknowledgement().hrtcs, ElementsAre("1"));
  EXPECT_THAT(acknowledgement().missing, ElementsAre("2"));

  publish({1, 2});
  EXPECT_THAT(acknowledgement().missing, ElementsAre("2")) << "it has not received the stop";
  (void)latches_.at(2).on_stop(stop_.name());
  publish({1, 2});
  EXPECT_THAT(acknowledgement().hrtcs, ElementsAre("1", "2"));
  continue_without_2(300);
  EXPECT_THAT(acknowledgement().hrtcs, ElementsAre("1", "2")) << "it had acknowledged the stop";
  EXPECT_THAT(acknowledgement().missing, IsEmpty());
}

TEST_F(RecipientsTest, AnHrtcThatRestartsHasToAcknowledgeAgain) {
  (void)latches_.at(1).on_stop(stop_.name());
  (void)latches_.at(2).on_stop(stop_.name());
  publish({1, 2});
  EXPECT_THAT(acknowledgement().missing, IsEmpty());
  ++incarnation_;
  latches_.erase(2);
  publish({2});
  EXPECT_THAT(acknowledgement().missing, ElementsAre("2"));
}

TEST_F(RecipientsTest, AnHrtcThatHasLeftIsNotMissing) {
  continue_without_2(20);
  EXPECT_EQ(roster_.find(2), nullptr);
  publish({2}, true);
  EXPECT_THAT(acknowledgement().missing, IsEmpty());
}

/// Simulates HRTCs, issuers of stops and operators who send resets, over a network that loses, duplicates and reorders
/// samples. A sender repeats its sample until all HRTCs have acknowledged it. An issuer may stop running before that,
/// an operator may not.
class StopSimulation {
 public:
  explicit StopSimulation(std::uint32_t seed, std::size_t max_stop_issuers = kMaxStopIssuers)
      : max_stop_issuers_{max_stop_issuers}, random_{seed} {
    for (std::uint64_t id = 1; id <= kHrtcs; ++id) start_hrtc(id);
  }

  void run(bool restarts) {
    for (int step = 0; step < 400; ++step) {
      if (step < 250 && chance(0.05)) issue_stop();
      if (chance(0.02)) issue_reset(0.7);
      if (chance(0.05)) kill_an_issuer();
      if (restarts && chance(0.05)) restart_an_hrtc();
      publish();
      deliver(12);
    }
    deliver_all();
  }
  void reset_all_stops() {
    issue_reset(1);
    deliver_all();
  }
  /// Issues stops until their issuers exceed the records of the HRTCs, without any reset.
  void issue_many_stops() {
    while (stop_issuers_ < max_stop_issuers_) {
      issue_stop();
      publish();
      deliver(40);
    }
    deliver_all();
  }

  [[nodiscard]] bool every_stop_was_named() const {
    return std::all_of(newest_received_.begin(), newest_received_.end(), [this](const auto& stop) {
      const auto named = newest_named_.find(stop.first);
      return named != newest_named_.end() && named->second >= stop.second;
    });
  }
  [[nodiscard]] std::size_t hrtcs_with_forces() const {
    return static_cast<std::size_t>(
        std::count_if(hrtcs_.begin(), hrtcs_.end(), [](const auto& hrtc) { return !hrtc.second.stopped(); }));
  }
  /// Whether no HRTC counted a reset twice.
  [[nodiscard]] bool no_reset_counted_twice() const {
    return std::all_of(counted_.begin(), counted_.end(), [](const auto& counted) { return counted.second == 1; });
  }
  [[nodiscard]] bool all_senders_are_done() const { return stops_.empty() && resets_.empty(); }

  static constexpr std::uint64_t kHrtcs = 4;

 private:
  using Issuer = std::pair<std::uint64_t, std::uint64_t>;  // participant, incarnation
  struct Packet {
    std::uint64_t to;
    std::variant<EmergencyStop, ForceReset, RosterEntry> sample;
  };

  bool chance(double probability) { return std::uniform_real_distribution<>{}(random_) < probability; }
  std::ptrdiff_t random_below(std::size_t bound) {
    return std::uniform_int_distribution<std::ptrdiff_t>{0, static_cast<std::ptrdiff_t>(bound) - 1}(random_);
  }

  void start_hrtc(std::uint64_t id) {
    ++incarnation_;
    incarnations_[id] = incarnation_;
    hrtcs_.insert_or_assign(id, StopLatch{origin(id, incarnation_)});
  }
  [[nodiscard]] bool stands_at_another_hrtc(const StopName& stop, std::uint64_t id) const {
    return std::any_of(hrtcs_.begin(), hrtcs_.end(), [&](const auto& hrtc) {
      const std::vector<StopName> stops = standing_stops(hrtc.second.records());
      return hrtc.first != id && std::any_of(stops.begin(), stops.end(), [&](const StopName& other) {
               return other.participant == stop.participant && other.number >= stop.number;
             });
    });
  }
  /// Restarts a random HRTC. Spares an HRTC with the only record of a stop, which would be lost.
  void restart_an_hrtc() {
    const std::uint64_t id = 1 + static_cast<std::uint64_t>(random_below(kHrtcs));
    const std::vector<StopName> stops = standing_stops(hrtcs_.at(id).records());
    if (std::all_of(stops.begin(), stops.end(), [&](const StopName& stop) { return stands_at_another_hrtc(stop, id); }))
      start_hrtc(id);
  }

  /// Issues a further stop of an issuer, or the first stop of a new issuer, if there are fewer than max_stop_issuers_.
  void issue_stop() {
    if (!stops_.empty() && chance(0.3)) {
      ++stops_[static_cast<std::size_t>(random_below(stops_.size()))].number;
    } else if (stop_issuers_ < max_stop_issuers_) {
      ++stop_issuers_;
      stops_.push_back({origin(100 + senders_++), 1, ""});
    }
  }
  void kill_an_issuer() {
    if (!stops_.empty()) stops_.erase(stops_.begin() + random_below(stops_.size()));
  }
  /// Sends a reset that names a share of the standing stops, and sometimes stops that no HRTC has received yet. There
  /// are at most as many issuers of resets as a StopLatch has records.
  void issue_reset(double share) {
    if (share < 1 && reset_issuers_ >= kMaxResetIssuers) return;
    ++reset_issuers_;
    ForceReset sent = reset(100 + senders_++, 1, {});
    for (const auto& [id, hrtc] : hrtcs_)
      for (const StopName& stop : standing_stops(hrtc.records()))
        if (chance(share)) sent.stops.push_back(stop);
    for (const EmergencyStop& stop : stops_)
      if (chance(0.2)) sent.stops.push_back(stop.name());
    for (const StopName& stop : sent.stops) {
      std::uint32_t& newest = newest_named_[{stop.participant, stop.incarnation}];
      newest = std::max(newest, stop.number);
    }
    resets_.push_back(sent);
  }

  template <class Sample>
  void send(std::uint64_t to, const Sample& sample) {
    const int copies = chance(loss_) ? 0 : chance(0.2) ? 2 : 1;
    for (int i = 0; i < copies; ++i) network_.push_back({to, sample});
  }
  /// Drops the samples that all HRTCs have acknowledged and sends the others again.
  template <class Sample>
  void repeat(std::vector<Sample>& samples) {
    samples.erase(std::remove_if(samples.begin(), samples.end(),
                                 [this](const Sample& sample) {
                                   return std::all_of(hrtcs_.begin(), hrtcs_.end(), [&](const auto& hrtc) {
                                     return acknowledges(entry(hrtc.first, hrtc.second, incarnations_.at(hrtc.first)),
                                                         sample);
                                   });
                                 }),
                  samples.end());
    for (const Sample& sample : samples)
      for (const auto& [id, hrtc] : hrtcs_) send(id, sample);
  }
  void publish() {
    for (const auto& [from, hrtc] : hrtcs_)
      for (std::uint64_t to = 1; to <= kHrtcs; ++to)
        if (from != to) send(to, entry(from, hrtc, incarnations_.at(from)));
    repeat(stops_);
    repeat(resets_);
  }

  void receive(std::uint64_t to, const EmergencyStop& stop) {
    (void)hrtcs_.at(to).on_stop(stop.name());
    std::uint32_t& newest = newest_received_[{stop.origin.participant, stop.origin.incarnation}];
    newest = std::max(newest, stop.number);
  }
  void receive(std::uint64_t to, const ForceReset& reset) {
    if (hrtcs_.at(to).on_reset(reset)) ++counted_[{to, incarnations_.at(to), reset.origin.participant}];
  }
  void receive(std::uint64_t to, const RosterEntry& entry) { (void)hrtcs_.at(to).on_roster(entry); }
  void deliver(std::size_t count) {
    for (; count > 0 && !network_.empty(); --count) {
      std::swap(network_[static_cast<std::size_t>(random_below(network_.size()))], network_.back());
      const Packet packet = network_.back();
      network_.pop_back();
      std::visit([&](const auto& sample) { receive(packet.to, sample); }, packet.sample);
    }
  }
  /// Ends all losses and delivers all packets.
  void deliver_all() {
    loss_ = 0;
    for (int round = 0; round < 10; ++round) {
      publish();
      deliver(network_.size());
    }
  }

  std::size_t max_stop_issuers_;
  std::mt19937 random_;
  double loss_ = 0.3;
  std::map<std::uint64_t, StopLatch> hrtcs_;
  std::vector<EmergencyStop> stops_;  // of issuers that run
  std::vector<ForceReset> resets_;
  std::vector<Packet> network_;
  std::map<Issuer, std::uint32_t> newest_received_;  // number of the newest stop that an HRTC has received
  std::map<Issuer, std::uint32_t> newest_named_;     // number of the newest stop that a reset has named
  std::map<std::tuple<std::uint64_t, std::uint64_t, std::uint64_t>, int> counted_;  // by HRTC, incarnation, issuer
  std::map<std::uint64_t, std::uint64_t> incarnations_;                             // of the HRTCs
  std::size_t stop_issuers_ = 0, reset_issuers_ = 0;
  std::uint64_t senders_ = 0;  // of stops and resets
  std::uint64_t incarnation_ = 0;
};

#if defined(__SANITIZE_THREAD__) || defined(__SANITIZE_ADDRESS__)
constexpr std::uint32_t kInterleavings = 300;
#else
constexpr std::uint32_t kInterleavings = 5000;  // of each of the two tests
#endif

// A stop may arrive at an HRTC after the reset that names it, when the sender of the reset is done. Then it stands
// there until the next reset.
TEST(StopSimulation, NoForceIsOnBeforeEveryStopWasNamedByAReset) {
  int seeds_with_forces = 0, seeds_with_late_stops = 0, seeds_without_forces = 0;
  for (std::uint32_t seed = 1; seed <= kInterleavings; ++seed) {
    StopSimulation simulation{seed};
    simulation.run(false);
    ASSERT_TRUE(simulation.all_senders_are_done()) << "seed " << seed;
    if (!simulation.every_stop_was_named()) {
      ASSERT_EQ(simulation.hrtcs_with_forces(), 0u) << "seed " << seed;
      ++seeds_without_forces;
    } else {
      ++(simulation.hrtcs_with_forces() == StopSimulation::kHrtcs ? seeds_with_forces : seeds_with_late_stops);
    }
    simulation.reset_all_stops();
    ASSERT_EQ(simulation.hrtcs_with_forces(), StopSimulation::kHrtcs) << "seed " << seed;
    ASSERT_TRUE(simulation.no_reset_counted_twice()) << "seed " << seed;
  }
  EXPECT_LT(seeds_with_late_stops, 10);
  EXPECT_GT(seeds_with_forces, 10);
  EXPECT_GT(seeds_without_forces, 10);
}

TEST(StopSimulation, NoForceIsOnWithoutAResetWhileHrtcsRestart) {
  int seeds_without_forces = 0;
  for (std::uint32_t seed = 1; seed <= kInterleavings; ++seed) {
    StopSimulation simulation{seed};
    simulation.run(true);
    if (!simulation.every_stop_was_named()) {
      ASSERT_EQ(simulation.hrtcs_with_forces(), 0u) << "seed " << seed;
      ++seeds_without_forces;
    }
    simulation.reset_all_stops();
    ASSERT_EQ(simulation.hrtcs_with_forces(), StopSimulation::kHrtcs) << "seed " << seed;
    ASSERT_TRUE(simulation.no_reset_counted_twice()) << "seed " << seed;
  }
  EXPECT_GT(seeds_without_forces, 10);
}

// HRTCs forward stops that do not fit to HRTCs that have applied the first reset already. These issue own stops again,
// which only the second reset names.
TEST(StopSimulation, TwoResetsEndMoreStopsThanAnHrtcRecords) {
  for (std::uint32_t seed = 1; seed <= 100; ++seed) {
    StopSimulation simulation{seed, 2 * kMaxStopIssuers};
    simulation.issue_many_stops();
    ASSERT_EQ(simulation.hrtcs_with_forces(), 0u) << "seed " << seed;
    for (int resets = 0; resets < 2; ++resets) simulation.reset_all_stops();
    ASSERT_EQ(simulation.hrtcs_with_forces(), StopSimulation::kHrtcs) << "seed " << seed;
    ASSERT_TRUE(simulation.all_senders_are_done()) << "seed " << seed;
    ASSERT_TRUE(simulation.no_reset_counted_twice()) << "seed " << seed;
  }
}

}  // namespace
}  // namespace tactus::session
