// Users at several HRTCs push, lift and hold one object. A host and HRTCs run without DDS in virtual time.

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

constexpr double kCrateHalfEdge = 0.05;  // m, of the crate

/// A session with a crate. `delay_ms`: delay of each link between two programs. `mass`: of the crate, kg.
class Session : public SharedSession {
 public:
  explicit Session(std::int64_t delay_ms, double mass = 0.8, bool host_begins_late = false)
      : SharedSession{crate(), settings(delay_ms, mass, host_begins_late)} {}

  void run(
      double seconds, const std::function<void()>& after_each_ms = [] {}) {
    for (int ms = 0; ms < static_cast<int>(seconds * 1000); ++ms) {
      step();
      after_each_ms();
    }
  }

 private:
  static const study::Subject& crate() {
    static const study::Subject kCrate = study::make_subject("crate", "box", 1200, 2 * kCrateHalfEdge);
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

/// Height of the crate's underside above the ground, m.
double height(const Session& session) { return session.viewer_pose().pose.position[2] - kCrateHalfEdge; }

TEST(SharedBody, APushIsFeltBeforeTheGrantAndMovesTheObjectAtAllHrtcs) {
  Session session{20};
  session.add_hrtc();
  session.add_hrtc();
  const std::size_t ann = session.add_hand(0, {kCrateHalfEdge + 0.03, 0, kCrateHalfEdge});
  session.run(1);
  ASSERT_EQ(session.role(0), Claimant::Role::kWatching);
  double force_before_grant = 0;
  Vec3d hand{kCrateHalfEdge + 0.03, 0, kCrateHalfEdge};
  session.run(1.5, [&] {
    hand.x() -= 6e-5;
    session.move_hand(ann, hand);
    if (session.role(0) == Claimant::Role::kRequesting)
      force_before_grant = std::max(force_before_grant, hrtc_service::vec(session.probe(ann).force).norm());
  });
  EXPECT_GT(force_before_grant, 0.1);
  EXPECT_EQ(session.role(0), Claimant::Role::kOwner);
  EXPECT_TRUE(session.body(0)->is_touched);
  const double pushed_x = session.body(0)->state.position.x();
  EXPECT_LT(pushed_x, -0.01);
  EXPECT_NEAR(session.body(1)->state.position.x(), pushed_x, 0.002) << "at the other HRTC";
  EXPECT_FALSE(session.body(1)->is_simulated);

  session.move_hand(ann, {kCrateHalfEdge + 0.1, 0, kCrateHalfEdge});
  session.run(1.5);
  EXPECT_EQ(session.role(0), Claimant::Role::kWatching);
  EXPECT_FALSE(session.body(0)->is_simulated);
  EXPECT_NEAR(session.body(0)->state.position.x(), session.body(1)->state.position.x(), 1e-6);
  EXPECT_FALSE(session.object_authority().busy());
  EXPECT_NEAR(height(session), 0, 1e-3);
  EXPECT_GE(session.port(ann).lowest, -1e-6);
}

/// The result of a lift by two users. Lengths in m, unless the name has a unit.
struct Lift {
  double max_height = 0, seconds_lifted = 0, final_height = 0;
  double peak_force = 0;  ///< N
  double copy_distance_mm = 0, injected_energy_mj = 0;
  double min_port_energy = 0;  ///< J
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
    result.max_height = std::max(result.max_height, height(session));
    result.seconds_lifted += height(session) > 0.09 ? 1e-3 : 0;
    for (const std::size_t user : {ann, bob})
      result.peak_force = std::max(result.peak_force, hrtc_service::vec(session.probe(user).force).norm());
  });
  for (const std::size_t user : {ann, bob}) {
    result.min_port_energy = std::min(result.min_port_energy, session.port(user).lowest);
    result.lifts += session.operator_of(user).tally().lifts;
  }
  for (std::size_t hrtc = 0; hrtc < (two_hrtcs ? 2u : 1u); ++hrtc) {
    result.copy_distance_mm =
        std::max(result.copy_distance_mm, 1e-3 * session.figure(hrtc, session::figures::kCopiesApart));
    result.injected_energy_mj += 1e-3 * session.figure(hrtc, session::figures::kCopyGiven);
  }
  result.final_height = height(session);
  return result;
}

/// The delay of a wave-variable channel is the age of its samples. The clock of the second HRTC is half a second ahead.
/// Until this clock is synchronised, samples seem half a second old at this HRTC. If the channels used these ages
/// later, the copies would drift apart by centimetres.
TEST(SharedBody, CopiesStayTogetherWhenHrtcsJoinBeforeTheirClocksAreSynchronised) {
  Session session{2, 0.8, true};
  const auto side = [](double sign, double gap) -> Vec3d {
    return {sign * (kCrateHalfEdge + 0.003 + gap), 0, kCrateHalfEdge};
  };
  session.add_hrtc();
  const std::size_t ann = session.add_hand(0, side(1, 0.03));
  session.run(0.5);
  session.add_hrtc(500'000'000);
  const std::size_t bob = session.add_hand(1, side(-1, 0.006));
  session.run(0.02);
  double gap = 0.006, carried_x = 0;
  std::uint32_t copies = 0;
  session.run(3, [&] {  // the hands press from both sides, and carry the crate along x
    copies = std::max(copies, std::min(session.body(0)->copies, session.body(1)->copies));
    gap = std::max(gap - 2e-4, -0.004);
    carried_x += gap <= -0.004 ? 2e-5 : 0;
    session.move_hand(ann, side(1, gap) + carried_x * Vec3d::UnitX());
    session.move_hand(bob, side(-1, gap) + carried_x * Vec3d::UnitX());
  });
  EXPECT_GT(copies, 0u);
  for (std::size_t hrtc = 0; hrtc < 2; ++hrtc) {
    SCOPED_TRACE(hrtc);
    EXPECT_GE(session.figure(hrtc, session::figures::kCopyGroups), 1);
    EXPECT_GT(session.body(hrtc)->state.position.x(), 0.02);
    EXPECT_LT(1e-3 * session.figure(hrtc, session::figures::kCopiesApart), 1.5 + 0.6 * 2) << "mm";
  }
}

TEST(SharedBody, TwoUsersLiftACrateAtTwoHrtcsAsTheyDoAtOneHrtc) {
  const Lift single = lift(false, 2);
  EXPECT_EQ(single.lifts, 2u);
  EXPECT_NEAR(single.max_height, 0.1, 0.015);
  EXPECT_GT(single.seconds_lifted, 1.9);
  EXPECT_EQ(single.copy_distance_mm, 0) << "one HRTC has no copies";
  for (const std::int64_t delay_ms : {2, 25}) {
    SCOPED_TRACE(delay_ms);
    const Lift shared = lift(true, delay_ms);
    EXPECT_EQ(shared.lifts, 2u);
    EXPECT_NEAR(shared.max_height, single.max_height, 0.01);
    EXPECT_NEAR(shared.seconds_lifted, single.seconds_lifted, 0.5);
    EXPECT_NEAR(shared.final_height, 0, 0.002);
    EXPECT_GT(shared.copy_distance_mm, 0);
    EXPECT_LT(shared.copy_distance_mm, 1.5 + 0.6 * static_cast<double>(delay_ms))
        << "forces of 6 N displace the copies";
    EXPECT_LT(shared.injected_energy_mj, 1);
    EXPECT_GE(shared.min_port_energy, -1e-6);
    EXPECT_LT(shared.peak_force, 8.001);
  }
}

/// A user who grabs the crate from above and then performs the actions `following`. `x_share`: grabbed position along
/// x, as a share of the crate's length.
client_sim::User grabber(const std::string& name, double x_share, const std::string& following) {
  const std::string text = "name: grab\nusers:\n  - name: " + name +
                           "\n    script:\n      - grab: {object: crate, direction: [0, 0, 1], point: [" +
                           std::to_string(x_share) + ", 0.5, 0.5]}\n" + following;
  return client_sim::parse_scenario(text, "test").users.front();
}

double tilt_of(const BodyReport& body) {
  return std::acos(std::clamp((body.state.orientation * Vec3d::UnitZ()).z(), -1.0, 1.0));
}

TEST(SharedBody, AHeldObjectFollowsTheHandUntilItIsReleased) {
  Session session{5};
  session.add_hrtc();
  session.add_hrtc();
  const std::size_t ann = session.add_user(0, grabber("ann", 0.3,
                                                      "      - move: {by: [0.05, 0, 0.1], speed: 0.1, seconds: 1}\n"
                                                      "      - move: {by: [0, 0, -0.1], speed: 0.1, seconds: 0.3}\n"
                                                      "      - release: {}\n"));
  double max_height = 0, max_tilt = 0, peak_force = 0, lifted_x = 0;
  session.run(8, [&] {
    max_height = std::max(max_height, height(session));
    peak_force = std::max(peak_force, hrtc_service::vec(session.probe(ann).force).norm());
    if (height(session) > 0.09) lifted_x = session.body(1)->state.position.x();
    if (session.body(0) != nullptr) max_tilt = std::max(max_tilt, tilt_of(*session.body(0)));
  });
  EXPECT_EQ(session.operator_of(ann).tally().grabs, 1u);
  EXPECT_EQ(session.operator_of(ann).tally().grabs_lost, 0u);
  EXPECT_NEAR(max_height, 0.1, 0.01);
  EXPECT_NEAR(lifted_x, 0.05, 0.005) << "at the other HRTC";
  EXPECT_GT(peak_force, 0.8 * 9.81 - 0.5) << "the hand feels the weight";
  EXPECT_LT(peak_force, 8.001);
  EXPECT_LT(max_tilt, 0.15) << "the weight exerts 0.16 N m, and the rotational stiffness is 2.5 N m/rad";
  EXPECT_NEAR(height(session), 0, 1e-3);
  EXPECT_EQ(session.role(0), Claimant::Role::kWatching);
  EXPECT_FALSE(session.body(0)->is_touched);
  EXPECT_GE(session.port(ann).lowest, -1e-6);
  EXPECT_EQ(session.figure(0, session::figures::kGrabs), 1);
  EXPECT_EQ(session.figure(0, session::figures::kGrabsRefused), 0);
}

TEST(SharedBody, ASecondHandStillHoldsTheCrateWhenTheFirstReleasesIt) {
  Session session{5, 0.4};
  session.add_hrtc();
  session.add_hrtc();
  const std::size_t ann = session.add_user(0, grabber("ann", 0.3,
                                                      "      - move: {by: [0, 0, 0.1], speed: 0.1, seconds: 3}\n"
                                                      "      - release: {}\n"));
  const std::size_t bob = session.add_user(1, grabber("bob", 0.7,
                                                      "      - move: {by: [0, 0, 0.1], speed: 0.1, seconds: 6}\n"
                                                      "      - release: {}\n"));
  double min_height_after_release = 1;
  bool two_copies = false;
  session.run(1);
  session.run(7, [&] {
    two_copies = two_copies || (session.body(0)->copies == 2 && session.body(1)->copies == 2);
    if (session.operator_of(ann).done()) min_height_after_release = std::min(min_height_after_release, height(session));
  });
  EXPECT_TRUE(two_copies);
  EXPECT_LT(session.figure(0, session::figures::kCopiesApart), 10'000);
  EXPECT_EQ(session.role(0), Claimant::Role::kWatching);
  EXPECT_EQ(session.role(1), Claimant::Role::kOwner);
  EXPECT_GT(min_height_after_release, 0.06) << "bob holds the crate alone";
  session.run(3);
  EXPECT_EQ(session.operator_of(bob).tally().grabs, 1u);
  EXPECT_EQ(session.operator_of(bob).tally().grabs_lost, 0u);
  EXPECT_EQ(session.role(1), Claimant::Role::kWatching);
  EXPECT_NEAR(height(session), 0, 2e-3);
  for (const std::size_t user : {ann, bob}) EXPECT_GE(session.port(user).lowest, -1e-6);
}

TEST(SharedBody, AnObjectThatADeadHrtcHeldFallsWhenTheLeaseEnds) {
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
  EXPECT_EQ(session.viewer_pose().fencing, fencing) << "the lease is at least 250 ms";
  session.run(0.8);
  EXPECT_GT(session.viewer_pose().fencing, fencing);
  EXPECT_NEAR(height(session), 0, 1e-3);
  EXPECT_NEAR(session.body(1)->state.position.z(), kCrateHalfEdge, 1e-3);
}

/// Two users at two HRTCs who hold the crate above the ground.
class CrateHeldByTwo : public ::testing::Test {
 protected:
  CrateHeldByTwo() {
    session_.add_hrtc();
    session_.add_hrtc();
    session_.add_user(0, lifter("ann", {1, 0, 0}, 100));
    session_.add_user(1, lifter("bob", {-1, 0, 0}, 100));
    session_.run(6);
  }
  [[nodiscard]] bool both_hold() const { return session_.body(0)->is_touched && session_.body(1)->is_touched; }
  /// Distance of the two copies, m.
  [[nodiscard]] double copy_distance() const {
    return (session_.body(0)->state.position - session_.body(1)->state.position).norm();
  }

  Session session_{5};
};

TEST_F(CrateHeldByTwo, CopiesContinueWithoutTheHostAndGetAGrantAfterItsRestart) {
  ASSERT_TRUE(both_hold());
  ASSERT_GT(height(session_), 0.08);
  const std::uint64_t fencing_before = session_.viewer_pose().fencing;
  const std::int64_t session_begin_ns = session_.now_ns() - session_.viewer_pose().session_time_ns;
  session_.stop_host();
  double min_z = 1, max_distance = 0;
  const auto measure = [&] {
    min_z = std::min(min_z, session_.body(0)->state.position.z());
    max_distance = std::max(max_distance, copy_distance());
  };
  session_.run(1, measure);
  EXPECT_EQ(session_.role(0), Claimant::Role::kRequesting);
  EXPECT_EQ(session_.body(0)->copies, 2u);
  session_.start_host();
  session_.run(1, measure);
  EXPECT_TRUE(both_hold());
  EXPECT_GT(min_z, kCrateHalfEdge + 0.08) << "the crate did not fall";
  EXPECT_LT(max_distance, 0.005);
  EXPECT_GT(session_.viewer_pose().fencing, fencing_before);
  EXPECT_EQ((std::set{session_.role(0), session_.role(1)}), (std::set{Claimant::Role::kLeader, Claimant::Role::kCopy}));
  EXPECT_NEAR(1e-6 * static_cast<double>(session_.now_ns() - session_.viewer_pose().session_time_ns - session_begin_ns),
              0, 20)
      << "ms";
}

TEST_F(CrateHeldByTwo, TheRemainingHrtcOwnsTheObjectWhenTheOtherDies) {
  ASSERT_TRUE(both_hold());
  session_.kill_hrtc(0);
  session_.run(0.3);
  EXPECT_EQ(session_.role(1), Claimant::Role::kOwner);
  EXPECT_EQ(session_.body(1)->copies, 0u);
  session_.run(3);  // one hand that presses from the side cannot hold the crate up
  EXPECT_NEAR(height(session_), 0, 0.005);
  EXPECT_NEAR(session_.body(1)->state.position.z(), kCrateHalfEdge, 0.005);
}

}  // namespace
}  // namespace tactus
