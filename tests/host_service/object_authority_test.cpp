#include "host_service/object_authority.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>

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
  void claim(std::uint64_t participant, bool touching) {
    session::ObjectClaim claim;
    claim.origin = origin_of(participant, 1);
    claim.object_id = kObject;
    claim.sequence = ++claims_;
    claim.touching = touching;
    object_authority_.on_claim(claim, now_);
  }

  ObjectAuthority object_authority_{origin_of(100, 1000)};
  std::int64_t now_ = 0;
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

TEST_F(ObjectAuthorityTest, TheHostThatJoinedFirstIsTheAuthorityAndTheOtherContinuesFromItsLastPose) {
  object_authority_.add(cube(0), now_);
  const session::Origin older = origin_of(90, 900);
  object_authority_.on_host(100, 2'000 * kMs, now_);
  object_authority_.on_host(older.participant, 1'000 * kMs, now_);
  object_authority_.on_catalogue(cube(0, older), now_);
  claim(7, true);
  run(400);
  EXPECT_EQ(poses_ + grants_, 0u);
  session::ObjectPose pose;
  pose.origin = older;
  pose.object_id = kObject;
  pose.fencing = 2000;
  pose.session_time_ns = now_;
  pose.pose.position = {4, 5, 0};
  for (pose.sequence = 1; pose.sequence <= 2; ++pose.sequence) object_authority_.on_pose(pose, now_, now_);
  object_authority_.on_host_gone(older.participant, now_);
  run(600);
  ASSERT_TRUE(pose_);
  EXPECT_GT(pose_->fencing, 2000u);
  EXPECT_NEAR(pose_->pose.position[0], 4, 1e-3);
  object_authority_.on_catalogue(cube(0, origin_of(90, 1)), now_);
  object_authority_.on_host(older.participant, 60'000 * kMs, now_);  // the older host is back, but now it joined later
  poses_ = 0;
  run(1000);
  EXPECT_GT(poses_, 0u);
}

TEST_F(ObjectAuthorityTest, AHostWithAWrongClockDoesNotBecomeTheAuthority) {
  object_authority_.on_host(100, 2'000 * kMs, now_);
  object_authority_.add(cube(0), now_);
  run(300);
  object_authority_.on_catalogue(cube(0, origin_of(90, 1)), now_);  // its clock shows 1970
  object_authority_.on_host(90, session::kNotJoined, now_);
  run(1000);
  object_authority_.on_host(90, 60'000 * kMs, now_);
  poses_ = 0;
  run(1000);
  EXPECT_GT(poses_, 0u);
}

TEST_F(ObjectAuthorityTest, AHostThatReturnsAfterAShortSilenceIsTheAuthorityAgain) {
  object_authority_.on_host(100, 2'000 * kMs, now_);
  object_authority_.on_host(90, 1'000 * kMs, now_);
  object_authority_.add(cube(0), now_);
  object_authority_.on_catalogue(cube(0, origin_of(90, 1)), now_);
  run(100);
  object_authority_.on_host_gone(90, now_);
  run(1000);
  EXPECT_GT(grants_, 0u);
  object_authority_.on_host(90, 1'000 * kMs, now_);  // within the DDS lease, so no catalogue arrives again
  grants_ = 0;
  run(1000);
  EXPECT_EQ(grants_, 0u);
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

}  // namespace
}  // namespace tactus::host_service
