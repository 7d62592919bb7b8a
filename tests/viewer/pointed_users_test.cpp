// Users who point: their clients, intents, refusals and ends.
#include "viewer/pointed_users.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "haptics/device.hpp"
#include "session/units.hpp"
#include "tests/support/constants.hpp"
#include "tests/viewer/viewer_session.hpp"

namespace tactus::viewer {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class PointedUsersTest : public ViewerSession {
 protected:
  static constexpr SourceId kPage = 7;

  PointedUsersTest() {
    users_.on_refused = [this](SourceId page, const std::string& reason) { refusals_.push_back({page, reason}); };
    add_hrtc("desk");
  }

  void add_hrtc(const std::string& name) { hrtcs_[name]; }

  /// Advances the time by `ns`, in steps of 2 ms. Every HRTC sends roster entries and serves the users that request it.
  void step(std::int64_t ns) {
    for (const std::int64_t end_ns = now_ns_ + ns; now_ns_ < end_ns;) {
      now_ns_ += 2 * kMs;
      for (auto& [name, served] : hrtcs_) viewer_.on_roster(entry_of(name, served), now_ns_);
      (void)viewer_.tick(now_ns_);
      PointedUserMessages out = users_.tick(now_ns_);
      for (const session::RosterEntry& entry : out.roster) {
        if (!hrtcs_serve_users_) continue;
        std::vector<session::UserProbe>& served = hrtcs_[entry.requested_hrtc];
        served.clear();
        if (!entry.leaving) served.push_back({entry.users.front(), 0});
      }
      entries_.insert(entries_.end(), out.roster.begin(), out.roster.end());
      for (auto& intent : out.intents) intents_.push_back(std::move(intent));
    }
  }

  /// The user "guest" of page kPage is served.
  void bring_guest() {
    step(10 * kMs);
    users_.on_touch(kPage, {"guest", ""}, now_ns_);
    step(20 * kMs);
  }

  [[nodiscard]] session::RosterEntry entry_of(const std::string& name, const std::vector<session::UserProbe>& served) {
    session::RosterEntry entry;
    entry.origin = {kSession, session::id_of(name), 1, now_ns_};
    entry.role = session::Role::kHrtc;
    entry.name = name;
    entry.session = "session";
    entry.heartbeat = ++heartbeats_;
    entry.served_users = served;
    return entry;
  }

  struct Refusal {
    SourceId page;
    std::string reason;
  };
  PointedUsers users_{viewer_, "view", "session", "page"};
  std::map<std::string, std::vector<session::UserProbe>> hrtcs_;  // by name: the served users
  bool hrtcs_serve_users_ = true;
  std::uint64_t heartbeats_ = 0;
  std::vector<session::RosterEntry> entries_;
  std::vector<PointedUserMessages::HandIntent> intents_;
  std::vector<Refusal> refusals_;
};

TEST_F(PointedUsersTest, ATouchRequestBringsAUserToAnHrtc) {
  step(10 * kMs);
  users_.on_touch(kPage, {"guest", ""}, now_ns_);
  step(10 * kMs);
  ASSERT_FALSE(entries_.empty());
  EXPECT_EQ(entries_[0].role, session::Role::kClient);
  EXPECT_EQ(entries_[0].name, "view.guest");
  EXPECT_EQ(entries_[0].requested_hrtc, "desk");
  EXPECT_THAT(entries_[0].users, ElementsAre("guest"));
}

TEST_F(PointedUsersTest, TheNewestTargetBecomesAnIntentOnceTheUserIsServed) {
  step(10 * kMs);
  users_.on_touch(kPage, {"guest", ""}, now_ns_);
  users_.on_hand(kPage, {{0.1, 0, 0}, false}, now_ns_);
  users_.on_hand(kPage, {{0.2, 0, 0}, true}, now_ns_);
  step(20 * kMs);
  ASSERT_EQ(intents_.size(), 1u);
  EXPECT_EQ(intents_[0].client, session::id_of("view.guest"));
  EXPECT_EQ(intents_[0].intent.user_id, session::id_of("guest"));
  EXPECT_EQ(intents_[0].intent.buttons, haptics::kGrabButton);
  EXPECT_THAT(intents_[0].intent.path.back().pose.position, ElementsAre(0.2, 0, 0));
}

TEST_F(PointedUsersTest, AnotherPageDoesNotMoveTheHand) {
  bring_guest();
  users_.on_hand(kPage + 1, {{0.1, 0, 0}, false}, now_ns_);
  step(20 * kMs);
  EXPECT_THAT(intents_, IsEmpty());
}

TEST_F(PointedUsersTest, ReleasingSendsLeaveMessagesAndFreesTheName) {
  bring_guest();
  users_.on_release(kPage);
  step(100 * kMs);
  EXPECT_TRUE(entries_.back().leaving);
  EXPECT_EQ(users_.size(), 0u);
  users_.on_touch(kPage, {"guest", ""}, now_ns_);
  EXPECT_EQ(users_.size(), 1u);
  EXPECT_EQ(refusals_.size(), 0u);
}

TEST_F(PointedUsersTest, APageGetsItsNameAgainAtOnce) {
  bring_guest();
  users_.on_release(kPage);
  users_.on_touch(kPage, {"guest", ""}, now_ns_);
  EXPECT_TRUE(users_.has_user(kPage));
  step(200 * kMs);
  EXPECT_EQ(refusals_.size(), 0u);
  EXPECT_EQ(users_.size(), 1u);
  EXPECT_FALSE(entries_.back().leaving);
  EXPECT_EQ(hrtcs_["desk"].size(), 1u);
}

TEST_F(PointedUsersTest, ANameIsFreeWhenTheHrtcNoLongerListsTheUser) {
  bring_guest();
  hrtcs_serve_users_ = false;
  users_.on_release(kPage);
  step(200 * kMs);
  users_.on_touch(kPage + 1, {"guest", ""}, now_ns_);
  step(200 * kMs);
  EXPECT_TRUE(entries_.back().leaving);
  hrtcs_["desk"].clear();
  hrtcs_serve_users_ = true;
  step(20 * kMs);
  EXPECT_EQ(refusals_.size(), 0u);
  EXPECT_FALSE(entries_.back().leaving);
  EXPECT_TRUE(users_.has_user(kPage + 1));
}

TEST_F(PointedUsersTest, ARequestIsRefusedIfTheHrtcStillListsTheOldUserAfterASecond) {
  bring_guest();
  hrtcs_serve_users_ = false;
  users_.on_release(kPage);
  users_.on_touch(kPage, {"guest", ""}, now_ns_);
  step(PointedUsers::kMaxLeaveNs + 200 * kMs);
  ASSERT_EQ(refusals_.size(), 1u);
  EXPECT_THAT(refusals_[0].reason, HasSubstr("'guest' is taken by a user of HRTC 'desk'"));
  EXPECT_EQ(users_.size(), 0u);
}

TEST_F(PointedUsersTest, TheNameOfALeavingUserGoesToTheFirstPageThatRequestsIt) {
  bring_guest();
  users_.on_release(kPage);
  users_.on_touch(kPage + 1, {"guest", ""}, now_ns_);
  users_.on_touch(kPage + 2, {"guest", ""}, now_ns_);
  ASSERT_EQ(refusals_.size(), 1u);
  EXPECT_EQ(refusals_[0].page, kPage + 2);
  EXPECT_THAT(refusals_[0].reason, HasSubstr("'guest' is taken by a user of another page"));
}

TEST_F(PointedUsersTest, APageThatReleasesWhileItWaitsGetsNoUser) {
  bring_guest();
  users_.on_release(kPage);
  users_.on_touch(kPage, {"guest", ""}, now_ns_);
  users_.on_release(kPage);
  step(200 * kMs);
  EXPECT_TRUE(entries_.back().leaving);
  EXPECT_EQ(users_.size(), 0u);
}

TEST_F(PointedUsersTest, TheHrtcWithFewerUsersIsChosenUnlessThePageNamesOne) {
  hrtcs_["desk"] = {{"ann", 0}};
  add_hrtc("lab");
  step(10 * kMs);
  users_.on_touch(kPage, {"guest", ""}, now_ns_);
  users_.on_touch(kPage + 1, {"other", "desk"}, now_ns_);
  hrtcs_serve_users_ = false;
  step(10 * kMs);
  std::map<std::string, std::string> chosen;
  for (const session::RosterEntry& entry : entries_) chosen[entry.name] = entry.requested_hrtc;
  EXPECT_EQ(chosen["view.guest"], "lab");
  EXPECT_EQ(chosen["view.other"], "desk");
}

TEST_F(PointedUsersTest, ANameThatAnotherUserHasIsRefused) {
  hrtcs_["desk"] = {{"ann", 0}};
  step(10 * kMs);
  users_.on_touch(kPage, {"ann", ""}, now_ns_);
  ASSERT_EQ(refusals_.size(), 1u);
  EXPECT_EQ(refusals_[0].page, kPage);
  EXPECT_THAT(refusals_[0].reason, HasSubstr("'ann' is taken"));
}

TEST_F(PointedUsersTest, AUserWhoCannotJoinIsRefusedAtOnceAndMayTryAgain) {
  step(10 * kMs);
  users_.on_touch(kPage, {"guest", ""}, now_ns_);
  users_.refuse(session::id_of("view.guest"), "the keys permit only ann");
  ASSERT_EQ(refusals_.size(), 1u);
  EXPECT_EQ(refusals_[0].page, kPage);
  EXPECT_EQ(refusals_[0].reason, "the keys permit only ann");
  EXPECT_FALSE(users_.has_user(kPage));
  step(100 * kMs);
  EXPECT_THAT(entries_, IsEmpty());
  bring_guest();
  EXPECT_EQ(refusals_.size(), 1u);
  EXPECT_TRUE(users_.has_user(kPage));
  users_.on_release(kPage);
  users_.refuse(session::id_of("view.guest"), "too late");
  EXPECT_EQ(refusals_.size(), 1u) << "the user leaves already";
}

TEST_F(PointedUsersTest, AnHrtcThatIsAbsentIsNamedInTheRefusal) {
  step(10 * kMs);
  users_.on_touch(kPage, {"guest", "lab"}, now_ns_);
  ASSERT_EQ(refusals_.size(), 1u);
  EXPECT_THAT(refusals_[0].reason, HasSubstr("HRTC 'lab' is not in the session"));
}

TEST_F(PointedUsersTest, AUserWithoutAProbeLeavesAfterFiveSeconds) {
  hrtcs_serve_users_ = false;
  step(10 * kMs);
  users_.on_touch(kPage, {"guest", ""}, now_ns_);
  step(PointedUsers::kMaxWaitNs - 10 * kMs);
  EXPECT_THAT(refusals_, IsEmpty());
  step(200 * kMs);
  ASSERT_EQ(refusals_.size(), 1u);
  EXPECT_THAT(refusals_[0].reason, HasSubstr("has given no probe within 5 s"));
  EXPECT_EQ(users_.size(), 0u);
}

TEST_F(PointedUsersTest, AUserThatIsServedLateStays) {
  hrtcs_serve_users_ = false;
  step(10 * kMs);
  users_.on_touch(kPage, {"guest", ""}, now_ns_);
  step(PointedUsers::kMaxSilenceNs + 1000 * kMs);
  hrtcs_serve_users_ = true;
  step(1000 * kMs);
  EXPECT_THAT(refusals_, IsEmpty());
  EXPECT_EQ(users_.size(), 1u);
}

TEST_F(PointedUsersTest, TheUserOfASilentPageLeaves) {
  step(10 * kMs);
  users_.on_touch(kPage, {"guest", ""}, now_ns_);
  step(PointedUsers::kMaxSilenceNs + 200 * kMs);
  ASSERT_EQ(refusals_.size(), 1u);
  EXPECT_THAT(refusals_[0].reason, HasSubstr("sent no hand position"));
  EXPECT_EQ(users_.size(), 0u);
}

TEST_F(PointedUsersTest, TheUserLeavesWithItsHrtc) {
  bring_guest();
  hrtcs_.clear();
  hrtcs_serve_users_ = false;
  step(1000 * kMs);
  ASSERT_EQ(refusals_.size(), 1u);
  EXPECT_THAT(refusals_[0].reason, HasSubstr("HRTC 'desk' has left the session"));
}

}  // namespace
}  // namespace tactus::viewer
