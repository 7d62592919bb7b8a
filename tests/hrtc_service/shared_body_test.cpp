// An object that several HRTCs hold, with all that host and HRTCs do except DDS, in virtual time.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "session/figures.hpp"
#include "study/shared_session.hpp"

namespace tactus {
namespace {

using hrtc_service::BodyReport;
using session::Claimant;
using spm::Vec3d;
using study::SharedSession;

constexpr double kHalf = 0.05;  // m, of the crate's edges

/// A crate of 0.8 kg and users around it, `delay_ms` from each other and from the host.
class Session : public SharedSession {
 public:
  explicit Session(std::int64_t delay_ms, double mass = 0.8, bool host_begins_late = false)
      : SharedSession{crate(), settings(delay_ms, mass, host_begins_late)} {}

  void run(
      double seconds, const std::function<void()>& each_ms = [] {}) {
    for (int ms = 0; ms < static_cast<int>(seconds * 1000); ++ms) {
      step();
      each_ms();
    }
  }

 private:
  static const study::Subject& crate() {
    static const study::Subject kCrate = study::make_subject("crate", "box", 1200, 2 * kHalf);
    return kCrate;
  }
  static study::SharedSessionSettings settings(std::int64_t delay_ms, double mass, bool host_begins_late) {
    study::SharedSessionSettings settings;
    settings.link = netem::parse_link("P0:delay=" + std::to_string(delay_ms));
    settings.mass = mass;
    settings.host_begins_late = host_begins_late;
    return settings;
  }
};

client_sim::User lifter(const char* name, const Vec3d& side, double seconds = 2) {
  client_sim::Action lift;
  lift.kind = client_sim::ActionKind::kLift;
  lift.object = "crate";
  lift.direction = side;
  lift.force = 6;
  lift.speed = 0.08;
  lift.height = 0.1;
  lift.seconds = seconds;
  client_sim::User user;
  user.name = name;
  user.script = {lift};
  return user;
}

double height(const Session& session) { return session.viewer_pose().pose.position[2] - kHalf; }

TEST(SharedBody, APushIsFeltAtOnceAndMovesTheObjectForAll) {
  Session session{20};
  session.add_hrtc();
  session.add_hrtc();
  const std::size_t ann = session.add_hand(0, {kHalf + 0.03, 0, kHalf});
  session.run(1);
  ASSERT_EQ(session.role(0), Claimant::Role::kWatching);
  double before_grant = 0;
  Vec3d hand{kHalf + 0.03, 0, kHalf};
  session.run(1.5, [&] {
    hand.x() -= 6e-5;
    session.move_hand(ann, hand);
    if (session.role(0) == Claimant::Role::kRequesting)
      before_grant = std::max(before_grant, hrtc_service::vec(session.probe(ann).force).norm());
  });
  EXPECT_GT(before_grant, 0.1) << "nobody waits for a grant to feel";
  EXPECT_EQ(session.role(0), Claimant::Role::kOwner);
  EXPECT_TRUE(session.body(0)->is_touched);
  const double pushed = session.body(0)->state.position.x();
  EXPECT_LT(pushed, -0.01);
  EXPECT_NEAR(session.body(1)->state.position.x(), pushed, 0.002) << "the other HRTC shows it there";
  EXPECT_FALSE(session.body(1)->is_simulated);

  session.move_hand(ann, {kHalf + 0.1, 0, kHalf});
  session.run(1.5);
  EXPECT_EQ(session.role(0), Claimant::Role::kWatching);
  EXPECT_FALSE(session.body(0)->is_simulated);
  EXPECT_NEAR(session.body(0)->state.position.x(), session.body(1)->state.position.x(), 1e-6);
  EXPECT_FALSE(session.object_authority().busy());
  EXPECT_NEAR(height(session), 0, 1e-3);
  EXPECT_GE(session.port(ann).lowest, -1e-6);
}

/// What came of a lift by two.
struct Lift {
  double highest = 0, held = 0, peak_force = 0, apart_mm = 0, given_mj = 0, lowest = 0, left = 0;
  std::uint32_t lifts = 0;
};

Lift lift(bool two_hrtcs, std::int64_t delay_ms) {
  Session session{delay_ms};
  session.add_hrtc();
  if (two_hrtcs) session.add_hrtc();
  const std::size_t ann = session.add_user(0, lifter("ann", {1, 0, 0}));
  const std::size_t bob = session.add_user(two_hrtcs ? 1 : 0, lifter("bob", {-1, 0, 0}));
  Lift result;
  session.run(1);
  session.run(11, [&] {
    result.highest = std::max(result.highest, height(session));
    result.held += height(session) > 0.09 ? 1e-3 : 0;
    for (const std::size_t user : {ann, bob})
      result.peak_force = std::max(result.peak_force, hrtc_service::vec(session.probe(user).force).norm());
  });
  for (const std::size_t user : {ann, bob}) {
    result.lowest = std::min(result.lowest, session.port(user).lowest);
    result.lifts += session.operator_of(user).tally().lifts;
  }
  for (std::size_t i = 0; i < (two_hrtcs ? 2u : 1u); ++i) {
    result.apart_mm = std::max(result.apart_mm, 1e-3 * session.figure(i, session::figures::kCopiesApart));
    result.given_mj += 1e-3 * session.figure(i, session::figures::kCopyGiven);
  }
  result.left = height(session);
  return result;
}

/// The channels between copies are as long as samples are under way. The samples that HRTCs exchange before their
/// clocks agree seem half a second old, and channels as long as that would let the copies drift centimetres apart.
TEST(SharedBody, CopiesStayTogetherAtHrtcsThatMeetBeforeTheirClocksAgree) {
  Session session{2, 0.8, true};
  const auto side = [](double sign, double gap) -> Vec3d { return {sign * (kHalf + 0.003 + gap), 0, kHalf}; };
  session.add_hrtc();
  const std::size_t ann = session.add_hand(0, side(1, 0.03));
  session.run(0.5);
  session.add_hrtc();
  const std::size_t bob = session.add_hand(1, side(-1, 0.03));
  session.run(0.8);
  double gap = 0.03, moved = 0;
  std::uint32_t copies = 0;
  session.run(3, [&] {  // they press from both sides, and carry it along
    copies = std::max(copies, std::min(session.body(0)->copies, session.body(1)->copies));
    gap = std::max(gap - 2e-4, -0.004);
    moved += gap <= -0.004 ? 2e-5 : 0;
    session.move_hand(ann, side(1, gap) + moved * Vec3d::UnitX());
    session.move_hand(bob, side(-1, gap) + moved * Vec3d::UnitX());
  });
  EXPECT_GT(copies, 0u);
  for (std::size_t hrtc = 0; hrtc < 2; ++hrtc) {
    SCOPED_TRACE(hrtc);
    EXPECT_GE(session.figure(hrtc, session::figures::kCopyGroups), 1);
    EXPECT_GT(session.body(hrtc)->state.position.x(), 0.02);
    EXPECT_LT(1e-3 * session.figure(hrtc, session::figures::kCopiesApart), 1.5 + 0.6 * 2) << "mm";
  }
}

TEST(SharedBody, TwoLiftACrateTogetherAsTheyWouldAtOneHrtc) {
  const Lift truth = lift(false, 2);
  EXPECT_EQ(truth.lifts, 2u);
  EXPECT_NEAR(truth.highest, 0.1, 0.015);
  EXPECT_GT(truth.held, 1.9);
  EXPECT_EQ(truth.apart_mm, 0) << "there is one only";
  for (const std::int64_t delay_ms : {2, 25}) {
    SCOPED_TRACE(delay_ms);
    const Lift shared = lift(true, delay_ms);
    EXPECT_EQ(shared.lifts, 2u);
    EXPECT_NEAR(shared.highest, truth.highest, 0.01);
    EXPECT_NEAR(shared.held, truth.held, 0.5);
    EXPECT_NEAR(shared.left, 0, 0.002);
    EXPECT_GT(shared.apart_mm, 0);
    EXPECT_LT(shared.apart_mm, 1.5 + 0.6 * static_cast<double>(delay_ms)) << "pressed together by 6 N";
    EXPECT_LT(shared.given_mj, 1);
    EXPECT_GE(shared.lowest, -1e-6);
    EXPECT_LT(shared.peak_force, 8.001);
  }
}

/// A user who takes the crate from above, at a third or two of its way along x.
client_sim::User grabber(const std::string& name, double along, const std::string& then) {
  const std::string text = "name: grab\nusers:\n  - name: " + name +
                           "\n    script:\n      - grab: {object: crate, direction: [0, 0, 1], point: [" +
                           std::to_string(along) + ", 0.5, 0.5]}\n" + then;
  return client_sim::parse_scenario(text, "test").users.front();
}

double tilt_of(const BodyReport& body) {
  return std::acos(std::clamp((body.state.orientation * Vec3d::UnitZ()).z(), -1.0, 1.0));
}

TEST(SharedBody, WhatAHandHoldsGoesWhereItGoesUntilItLetsGo) {
  Session session{5};
  session.add_hrtc();
  session.add_hrtc();
  const std::size_t ann = session.add_user(0, grabber("ann", 0.3,
                                                      "      - move: {by: [0.05, 0, 0.1], speed: 0.1, seconds: 1}\n"
                                                      "      - move: {by: [0, 0, -0.1], speed: 0.1, seconds: 0.3}\n"
                                                      "      - release: {}\n"));
  double highest = 0, tilted = 0, peak_force = 0, raised_at = 0;
  session.run(8, [&] {
    highest = std::max(highest, height(session));
    peak_force = std::max(peak_force, hrtc_service::vec(session.probe(ann).force).norm());
    if (height(session) > 0.09) raised_at = session.body(1)->state.position.x();
    if (session.body(0) != nullptr) tilted = std::max(tilted, tilt_of(*session.body(0)));
  });
  EXPECT_EQ(session.operator_of(ann).tally().grabs, 1u);
  EXPECT_EQ(session.operator_of(ann).tally().grabs_lost, 0u);
  EXPECT_NEAR(highest, 0.1, 0.01);
  EXPECT_NEAR(raised_at, 0.05, 0.005) << "as the other HRTC shows it";
  EXPECT_GT(peak_force, 0.8 * 9.81 - 0.5) << "its weight is felt";
  EXPECT_LT(peak_force, 8.001);
  EXPECT_LT(tilted, 0.15) << "0.16 N m of its weight, borne with 2.5 N m/rad";
  EXPECT_NEAR(height(session), 0, 1e-3);
  EXPECT_EQ(session.role(0), Claimant::Role::kWatching);
  EXPECT_FALSE(session.body(0)->is_touched);
  EXPECT_GE(session.port(ann).lowest, -1e-6);
  EXPECT_EQ(session.figure(0, session::figures::kGrabs), 1);
  EXPECT_EQ(session.figure(0, session::figures::kGrabsRefused), 0);
}

TEST(SharedBody, ASecondHandHoldsACopyAndKeepsTheCrateWhenTheFirstLetsGo) {
  Session session{5, 0.4};
  session.add_hrtc();
  session.add_hrtc();
  const std::size_t ann = session.add_user(0, grabber("ann", 0.3,
                                                      "      - move: {by: [0, 0, 0.1], speed: 0.1, seconds: 3}\n"
                                                      "      - release: {}\n"));
  const std::size_t bob = session.add_user(1, grabber("bob", 0.7,
                                                      "      - move: {by: [0, 0, 0.1], speed: 0.1, seconds: 6}\n"
                                                      "      - release: {}\n"));
  double lowest_after = 1;
  bool both = false;
  session.run(1);
  session.run(7, [&] {
    both = both || (session.body(0)->copies == 2 && session.body(1)->copies == 2);
    if (session.operator_of(ann).done()) lowest_after = std::min(lowest_after, height(session));
  });
  EXPECT_TRUE(both);
  EXPECT_LT(session.figure(0, session::figures::kCopiesApart), 10'000);
  EXPECT_EQ(session.role(0), Claimant::Role::kWatching);
  EXPECT_EQ(session.role(1), Claimant::Role::kOwner);
  EXPECT_GT(lowest_after, 0.06) << "bob holds it alone";
  session.run(3);
  EXPECT_EQ(session.operator_of(bob).tally().grabs, 1u);
  EXPECT_EQ(session.operator_of(bob).tally().grabs_lost, 0u);
  EXPECT_EQ(session.role(1), Claimant::Role::kWatching);
  EXPECT_NEAR(height(session), 0, 2e-3);
  for (const std::size_t user : {ann, bob}) EXPECT_GE(session.port(user).lowest, -1e-6);
}

TEST(SharedBody, WhatAControllerHeldWhenItDiedFallsWhenItsLeaseEnds) {
  Session session{5};
  session.add_hrtc();
  session.add_hrtc();
  (void)session.add_user(0, grabber("ann", 0.5, "      - move: {by: [0, 0, 0.1], speed: 0.1, seconds: 20}\n"));
  session.run(4);
  ASSERT_EQ(session.role(0), Claimant::Role::kOwner);
  ASSERT_NEAR(height(session), 0.1, 0.02);
  const std::uint64_t fencing = session.viewer_pose().fencing;
  session.kill_hrtc(0);
  session.run(0.2);
  EXPECT_EQ(session.viewer_pose().fencing, fencing) << "the lease is 250 ms at least";
  session.run(0.8);
  EXPECT_GT(session.viewer_pose().fencing, fencing);
  EXPECT_NEAR(height(session), 0, 1e-3);
  EXPECT_NEAR(session.body(1)->state.position.z(), kHalf, 1e-3);
}

/// Two who hold the crate in the air.
class HeldByTwo : public ::testing::Test {
 protected:
  HeldByTwo() {
    session_.add_hrtc();
    session_.add_hrtc();
    session_.add_user(0, lifter("ann", {1, 0, 0}, 100));
    session_.add_user(1, lifter("bob", {-1, 0, 0}, 100));
    session_.run(6);
  }
  [[nodiscard]] bool both_hold() const { return session_.body(0)->is_touched && session_.body(1)->is_touched; }
  /// Between the two copies, m.
  [[nodiscard]] double apart() const {
    return (session_.body(0)->state.position - session_.body(1)->state.position).norm();
  }

  Session session_{5};
};

TEST_F(HeldByTwo, CopiesGoOnWithoutTheirHostAndItTakesTheClaimsUpWhenItStartsAgain) {
  ASSERT_TRUE(both_hold());
  ASSERT_GT(height(session_), 0.08);
  const std::uint64_t before = session_.viewer_pose().fencing;
  const std::int64_t began_ns = session_.now_ns() - session_.viewer_pose().session_time_ns;  // of session time
  session_.stop_host();
  double lowest = 1, furthest = 0;
  session_.run(1, [&] {
    lowest = std::min(lowest, session_.body(0)->state.position.z());
    furthest = std::max(furthest, apart());
  });
  EXPECT_EQ(session_.role(0), Claimant::Role::kRequesting);
  EXPECT_EQ(session_.body(0)->copies, 2u);
  session_.start_host();
  session_.run(1, [&] {
    lowest = std::min(lowest, session_.body(0)->state.position.z());
    furthest = std::max(furthest, apart());
  });
  EXPECT_TRUE(both_hold());
  EXPECT_GT(lowest, kHalf + 0.08) << "nobody let it fall";
  EXPECT_LT(furthest, 0.005);
  EXPECT_GT(session_.viewer_pose().fencing, before);
  EXPECT_EQ((std::set{session_.role(0), session_.role(1)}), (std::set{Claimant::Role::kLeader, Claimant::Role::kCopy}));
  EXPECT_NEAR(1e-6 * static_cast<double>(session_.now_ns() - session_.viewer_pose().session_time_ns - began_ns), 0, 20)
      << "ms";
}

TEST_F(HeldByTwo, TheOneWhoIsLeftKeepsTheObject) {
  ASSERT_TRUE(both_hold());
  session_.kill_hrtc(0);
  session_.run(0.3);
  EXPECT_EQ(session_.role(1), Claimant::Role::kOwner);
  EXPECT_EQ(session_.body(1)->copies, 0u);
  session_.run(3);  // with one hand it cannot be held up
  EXPECT_NEAR(height(session_), 0, 0.005);
  EXPECT_NEAR(session_.body(1)->state.position.z(), kHalf, 0.005);
}

}  // namespace
}  // namespace tactus
