#include "host_service/object_authority.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "tests/support/constants.hpp"

namespace tactus::host_service {
namespace {

session::Origin origin_of(std::uint64_t participant, std::uint64_t incarnation) {
  session::Origin origin;
  origin.session = kSession;
  origin.participant = participant;
  origin.incarnation = incarnation;
  return origin;
}

/// A cube of 10 cm and 0.5 kg whose underside is `height` above the ground.
session::CatalogueEntry cube(double height, const session::Origin& host = origin_of(100, 1000)) {
  session::CatalogueEntry entry;
  entry.origin = host;
  entry.object_id = kObject;
  entry.summary.bounds_min = {0, 0, 0};
  entry.summary.bounds_max = {100, 100, 100};
  entry.scale = 0.001;
  entry.pose.position = {1, 2, height};
  entry.body = {0.5, sharing::inertia_of_bounds(entry.summary, entry.scale, 0.5), 0.5, 0};
  return entry;
}

/// An ObjectAuthority in virtual time.
class ObjectAuthorityTest : public ::testing::Test {
 protected:
  void run(std::int64_t ms) {
    for (; ms > 0; --ms) {
      now_ += kMs;
      const ObjectAuthority::Messages& messages = object_authority_.tick(now_, now_);
      poses_ += messages.poses.size();
      grants_ += messages.grants.size();
      if (!messages.poses.empty()) pose_ = messages.poses.back();
      if (!messages.grants.empty()) grant_ = messages.grants.back();
    }
  }
  /// Adds the cube, and an older host that serves it too.
  void add_with_older_host() {
    object_authority_.add(cube(0), now_);
    object_authority_.on_host(self_, 2'000 * kMs, now_);
    object_authority_.on_host(older_, 1'000 * kMs, now_);
    object_authority_.on_catalogue(cube(0, older_));
  }
  /// Runs while `host` sends a heartbeat every 30 ms.
  void run_with_heartbeats(std::int64_t ms, const session::Origin& host, std::int64_t joined_ns) {
    for (; ms >= 30; ms -= 30) {
      run(30);
      object_authority_.on_host(host, joined_ns, now_);
    }
  }
  void run_with_older_host(std::int64_t ms) { run_with_heartbeats(ms, older_, 1'000 * kMs); }
  /// Publishes `count` poses of the older host.
  void poses_of_older_host(std::uint32_t count) {
    session::ObjectPose pose;
    pose.origin = older_;
    pose.object_id = kObject;
    pose.fencing = 2000;
    pose.session_time_ns = now_;
    pose.pose.position = {4, 5, 0};
    for (; count > 0; --count) {
      pose.sequence = ++older_poses_;
      object_authority_.on_pose(pose, now_, now_);
    }
  }
  void claim(std::uint64_t participant, bool touching) {
    session::ObjectClaim claim;
    claim.origin = origin_of(participant, 1);
    claim.object_id = kObject;
    claim.sequence = ++claims_;
    claim.touching = touching;
    object_authority_.on_claim(claim, now_);
  }

  const session::Origin self_ = origin_of(100, 1000), older_ = origin_of(90, 900);
  ObjectAuthority object_authority_{self_};
  std::int64_t now_ = 0;
  std::uint32_t older_poses_ = 0;
  std::size_t poses_ = 0, grants_ = 0;
  std::uint32_t claims_ = 0;
  std::optional<session::ObjectPose> pose_;
  std::optional<session::ObjectGrant> grant_;
};

TEST_F(ObjectAuthorityTest, ADroppedObjectComesToRestAndThenIsNotSimulated) {
  object_authority_.add(cube(0.1), now_);
  run(260);
  EXPECT_TRUE(object_authority_.busy());
  run(1500);
  EXPECT_FALSE(object_authority_.busy());
  ASSERT_TRUE(pose_);
  EXPECT_NEAR(pose_->pose.position[2], 0, 1e-3);
  EXPECT_NEAR(pose_->pose.position[0], 1, 1e-3);
  const std::uint64_t steps = object_authority_.steps();
  EXPECT_GT(steps, 100u);
  poses_ = grants_ = 0;
  run(2000);
  EXPECT_EQ(object_authority_.steps(), steps);
  EXPECT_EQ(poses_, 10u) << "5 Hz";
  EXPECT_EQ(grants_, 4u);
}

TEST_F(ObjectAuthorityTest, PublishesPosesAt250HertzWhileTheObjectMoves) {
  object_authority_.add(cube(10), now_);
  run(300);
  poses_ = 0;
  run(400);
  EXPECT_EQ(poses_, 100u);
  EXPECT_LT(pose_->velocity[2], -3);
}

TEST_F(ObjectAuthorityTest, GrantsTheObjectToATouchingHrtcAndThenContinuesFromItsLastPose) {
  object_authority_.add(cube(0), now_);
  run(300);
  claim(7, true);
  run(1);
  ASSERT_TRUE(grant_);
  ASSERT_EQ(grant_->touchers.size(), 1u);
  EXPECT_EQ(grant_->touchers[0].participant, 7u);
  poses_ = 0;
  session::ObjectPose moved;
  for (std::uint32_t i = 1; i <= 50; ++i) {
    if (i % 10 == 1) claim(7, true);
    moved.origin = origin_of(7, 1);
    moved.object_id = kObject;
    moved.sequence = i;
    moved.fencing = grant_->fencing;
    moved.session_time_ns = now_;
    moved.pose.position = {1, 2, 0.002 * std::min(i, 25u)};  // at rest for the last 100 ms
    object_authority_.on_pose(moved, now_, now_);
    run(4);
  }
  EXPECT_EQ(poses_, 0u);
  claim(7, false);
  run(10);
  ASSERT_TRUE(pose_);
  EXPECT_GT(pose_->fencing, moved.fencing);
  EXPECT_NEAR(pose_->pose.position[2], 0.05, 0.002);
  run(1500);
  EXPECT_NEAR(pose_->pose.position[2], 0, 1e-3);
  moved.sequence = 60;
  object_authority_.on_pose(moved, now_, now_);  // from the previous owner
  run(300);
  EXPECT_NEAR(pose_->pose.position[2], 0, 1e-3);
}

TEST_F(ObjectAuthorityTest, ATouchingHrtcWithoutClaimsLosesTheObjectAfterTheLease) {
  object_authority_.add(cube(0), now_);
  run(300);
  claim(7, true);
  run(100);
  poses_ = 0;
  run(100);
  EXPECT_EQ(poses_, 0u);
  run(100);
  EXPECT_GT(poses_, 0u);
}

TEST_F(ObjectAuthorityTest, TheHostThatJoinedFirstIsTheAuthorityAndTheOtherTakesOverFromItsLastPose) {
  add_with_older_host();
  claim(7, true);
  run_with_older_host(600);
  EXPECT_EQ(poses_ + grants_, 0u);
  poses_of_older_host(2);
  object_authority_.on_host_gone(older_.participant);
  run(250);
  ASSERT_TRUE(pose_);
  EXPECT_GT(pose_->fencing, 2000u);
  EXPECT_NEAR(pose_->pose.position[0], 4, 1e-3);
  const session::Origin restarted = origin_of(older_.participant, older_.incarnation + 1);
  object_authority_.on_catalogue(cube(0, restarted));
  object_authority_.on_host(restarted, 60'000 * kMs, now_);  // the older host is back, but now it joined later
  poses_ = 0;
  run_with_heartbeats(1000, restarted, 60'000 * kMs);
  EXPECT_GT(poses_, 0u);
}

TEST_F(ObjectAuthorityTest, TakesOverFromAHostThatIsSilentForAQuarterOfASecond) {
  add_with_older_host();
  run_with_older_host(600);
  poses_of_older_host(2);
  run(249);
  EXPECT_EQ(poses_ + grants_, 0u) << "a lease of the other host may be valid";
  run(1);
  EXPECT_EQ(poses_, 1u);
  EXPECT_EQ(grants_, 1u);
  ASSERT_TRUE(pose_);
  EXPECT_GT(pose_->fencing, 2000u);
  EXPECT_NEAR(pose_->pose.position[0], 4, 1e-3);
  object_authority_.on_host(older_, 1'000 * kMs, now_);
  poses_ = grants_ = 0;
  run_with_older_host(600);
  EXPECT_EQ(poses_ + grants_, 0u) << "the other host has returned";
}

TEST_F(ObjectAuthorityTest, DoesNotTakeOverWhilePosesOfAHostWithoutHeartbeatsArrive) {
  add_with_older_host();
  for (int i = 0; i < 10; ++i) {
    poses_of_older_host(1);
    run(200);
  }
  EXPECT_EQ(poses_ + grants_, 0u);
}

TEST_F(ObjectAuthorityTest, ItsOwnPauseDoesNotCountAsSilenceOfAnotherHost) {
  add_with_older_host();
  run_with_older_host(600);
  now_ += 2000 * kMs;
  run(50);
  object_authority_.on_host(older_, 1'000 * kMs, now_);
  run_with_older_host(600);
  EXPECT_EQ(poses_ + grants_, 0u);
}

TEST_F(ObjectAuthorityTest, GrantsTheObjectToItsTouchersWhenItTakesOver) {
  add_with_older_host();
  run_with_older_host(600);
  for (int i = 0; i < 13; ++i) {
    claim(7, true);
    run(20);
  }
  EXPECT_EQ(poses_, 0u);
  ASSERT_TRUE(grant_);
  ASSERT_EQ(grant_->touchers.size(), 1u);
  EXPECT_EQ(grant_->touchers[0].participant, 7u);
}

TEST_F(ObjectAuthorityTest, AHostWithAWrongClockDoesNotBecomeTheAuthority) {
  const session::Origin wrong = origin_of(90, 1);  // its clock shows 1970
  object_authority_.on_host(self_, 2'000 * kMs, now_);
  object_authority_.add(cube(0), now_);
  run(300);
  object_authority_.on_catalogue(cube(0, wrong));
  run_with_heartbeats(1000, wrong, session::kNotJoined);
  poses_ = 0;
  run_with_heartbeats(1000, wrong, 60'000 * kMs);
  EXPECT_GT(poses_, 0u);
}

TEST_F(ObjectAuthorityTest, AHostThatReturnsAfterAShortSilenceIsTheAuthorityAgain) {
  add_with_older_host();
  run(100);
  object_authority_.on_host_gone(older_.participant);
  run(1000);
  EXPECT_GT(grants_, 0u);
  object_authority_.on_host(older_, 1'000 * kMs, now_);  // within the DDS lease, so no catalogue arrives again
  grants_ = 0;
  run_with_older_host(1000);
  EXPECT_EQ(grants_, 0u);
}

TEST_F(ObjectAuthorityTest, AHostThatRestartsWithoutTheObjectIsNotItsAuthority) {
  add_with_older_host();
  run_with_older_host(600);
  run_with_heartbeats(600, origin_of(older_.participant, older_.incarnation + 1), 1'000 * kMs);
  EXPECT_GT(poses_, 0u);
}

TEST_F(ObjectAuthorityTest, AHostThatServesTheObjectAsAStaticOneIsNotItsAuthority) {
  add_with_older_host();
  session::CatalogueEntry wall = cube(0, older_);
  wall.body = {};
  object_authority_.on_catalogue(wall);
  run_with_older_host(600);
  EXPECT_GT(poses_, 0u);
}

TEST_F(ObjectAuthorityTest, ARestartedHostGrantsLargerFencingNumbers) {
  object_authority_.add(cube(0), now_);
  run(1000);
  ObjectAuthority restarted{origin_of(100, 2000)};
  restarted.add(cube(0), now_);
  std::uint64_t fencing = 0;
  for (int ms = 0; ms < 1000; ++ms) {
    now_ += kMs;
    for (const session::ObjectPose& pose : restarted.tick(now_, now_).poses) fencing = pose.fencing;
  }
  EXPECT_GT(fencing, pose_->fencing);
}

TEST_F(ObjectAuthorityTest, IgnoresStaticObjects) {
  session::CatalogueEntry wall = cube(1);
  wall.body = {};
  object_authority_.add(wall, now_);
  EXPECT_TRUE(object_authority_.empty());
  run(1000);
  EXPECT_EQ(poses_ + grants_, 0u);
}

/// Several hosts of one cube, an HRTC, and a viewer that accepts poses as all receivers do. In virtual time.
class SharedCube : public ::testing::Test {
 protected:
  struct Host {
    session::Origin origin;
    ObjectAuthority authority;
    std::int64_t suspended_until_ns = 0;
    std::vector<std::function<void(ObjectAuthority&)>> postponed;  // samples that arrived while it was suspended
  };

  /// Hosts that joined one after the other, with a cube at this height.
  void start_hosts(std::size_t count, double height) {
    for (std::size_t i = 0; i < count; ++i) {
      const session::Origin origin = origin_of(90 + i, 900 + i);
      hosts_.push_back({origin, ObjectAuthority{origin}, 0, {}});
    }
    for (Host& host : hosts_) host.authority.add(cube(height, host.origin), now_);
    for (const Host& host : hosts_)
      for (Host& other : hosts_) other.authority.on_catalogue(cube(height, host.origin));
    heartbeats();
  }
  void kill(std::size_t host) { hosts_[host].suspended_until_ns = INT64_MAX; }
  void suspend(std::size_t host, std::int64_t ms) { hosts_[host].suspended_until_ns = now_ + ms * kMs; }
  void run(std::int64_t ms) {
    for (const std::int64_t end = now_ + ms * kMs; now_ < end;) step();
  }

  std::vector<Host> hosts_;
  session::Claimant hrtc_{origin_of(7, 1), kObject, {}};
  double hrtc_height_ = 0.5;  // of the cube while the HRTC owns it
  // What the viewer has accepted.
  std::optional<session::ObjectPose> pose_;
  std::int64_t accepted_ns_ = 0, max_gap_ns_ = 0;
  double max_height_ = 0;

 private:
  void send(const session::Origin& from, const std::function<void(ObjectAuthority&)>& sample) {
    for (Host& host : hosts_) {
      if (host.origin.participant == from.participant || host.suspended_until_ns == INT64_MAX) continue;
      if (now_ < host.suspended_until_ns)
        host.postponed.push_back(sample);
      else
        sample(host.authority);
    }
  }
  void heartbeats() {
    for (std::size_t i = 0; i < hosts_.size(); ++i) {
      if (now_ < hosts_[i].suspended_until_ns) continue;
      const session::Origin origin = hosts_[i].origin;
      const auto heartbeat = [=, this, joined_ns = static_cast<std::int64_t>(i) * kMs](ObjectAuthority& authority) {
        authority.on_host(origin, joined_ns, now_);
      };
      heartbeat(hosts_[i].authority);
      send(origin, heartbeat);
    }
  }
  void publish(const session::ObjectPose& pose) {
    send(pose.origin, [=, this](ObjectAuthority& authority) { authority.on_pose(pose, now_, now_); });
    if (!viewer_.accept(pose, now_)) return;
    max_gap_ns_ = std::max(max_gap_ns_, now_ - accepted_ns_);
    accepted_ns_ = now_;
    max_height_ = std::max(max_height_, pose.pose.position[2]);
    pose_ = pose;
  }
  void step() {
    now_ += kMs;
    if (now_ % (30 * kMs) == 0) heartbeats();
    for (Host& host : hosts_) {
      if (now_ < host.suspended_until_ns) continue;
      // A host that resumes may run before it reads the samples that arrived meanwhile.
      const ObjectAuthority::Messages messages = host.authority.tick(now_, now_);
      for (const session::ObjectGrant& grant : messages.grants) hrtc_.on_grant(grant, now_);
      for (const session::ObjectPose& pose : messages.poses) publish(pose);
      for (const auto& sample : std::exchange(host.postponed, {})) sample(host.authority);
    }
    if (const auto claim = hrtc_.tick(now_))
      send(claim->origin, [=, this](ObjectAuthority& authority) { authority.on_claim(*claim, now_); });
    if (hrtc_.role(now_) != session::Claimant::Role::kOwner || now_ % (4 * kMs) != 0) return;
    session::ObjectPose pose;
    pose.origin = origin_of(7, 1);
    pose.object_id = kObject;
    pose.sequence = ++hrtc_poses_;
    pose.fencing = hrtc_.fencing();
    pose.session_time_ns = now_;
    pose.pose.position = {1, 2, hrtc_height_};
    publish(pose);
  }

  std::int64_t now_ = 0;
  std::uint32_t hrtc_poses_ = 0;
  session::PoseAdmission viewer_;
};

TEST_F(SharedCube, ANewAuthorityPublishesPosesAQuarterOfASecondAfterTheEarlierOneDied) {
  start_hosts(3, 0);
  run(2000);
  for (std::size_t i = 0; i < 2; ++i) {
    ASSERT_TRUE(pose_);
    EXPECT_EQ(pose_->origin.participant, hosts_[i].origin.participant);
    kill(i);
    max_gap_ns_ = 0;
    run(300);
    EXPECT_EQ(pose_->origin.participant, hosts_[i + 1].origin.participant);
    run(1000);
    EXPECT_LE(max_gap_ns_, 455 * kMs) << "a pose every 200 ms before, and 255 ms without one";
  }
}

TEST_F(SharedCube, AnHrtcThatHoldsTheCubeKeepsItWhenTheAuthorityDies) {
  start_hosts(2, 0);
  run(1000);
  hrtc_.set_touching(true);
  run(500);
  ASSERT_EQ(pose_->origin.participant, 7u);
  max_gap_ns_ = 0;
  kill(0);
  run(1000);
  EXPECT_EQ(pose_->origin.participant, 7u);
  EXPECT_LE(max_gap_ns_, 60 * kMs);
  hrtc_height_ = 0.2;
  run(300);
  hrtc_.set_touching(false);
  run(10);
  EXPECT_EQ(pose_->origin.participant, hosts_[1].origin.participant);
  EXPECT_NEAR(pose_->pose.position[2], 0.2, 0.01);
}

TEST_F(SharedCube, AnHrtcThatReleasesTheCubeDuringATakeoverLeavesItWhereItIs) {
  start_hosts(2, 0);
  run(1000);
  hrtc_.set_touching(true);
  run(500);
  kill(0);
  run(150);  // the lease of the HRTC is still valid
  hrtc_height_ = 0.2;
  run(10);
  hrtc_.set_touching(false);
  max_height_ = 0;
  run(300);
  EXPECT_EQ(pose_->origin.participant, hosts_[1].origin.participant);
  EXPECT_LE(max_height_, 0.21);
}

TEST_F(SharedCube, AnAuthorityThatWasSuspendedTakesOverFromThePosesOfTheOther) {
  start_hosts(2, 2);
  run(600);
  ASSERT_TRUE(pose_);
  ASSERT_GT(pose_->pose.position[2], 0.5) << "the cube falls";
  suspend(0, 3000);
  run(2990);
  EXPECT_EQ(pose_->origin.participant, hosts_[1].origin.participant);
  EXPECT_NEAR(pose_->pose.position[2], 0, 1e-3);
  max_height_ = 0;
  run(2000);
  EXPECT_EQ(pose_->origin.participant, hosts_[0].origin.participant);
  EXPECT_LE(max_height_, 1e-3);
}

}  // namespace
}  // namespace tactus::host_service
