#include "sharing/pose_interpolator.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace tactus::sharing {
namespace {

constexpr std::int64_t kMs = 1'000'000;

/// A circle of 10 cm, one turn in two seconds.
BodyState on_circle(std::int64_t ns) {
  const double turn = 3.14159265358979 * 1e-9 * static_cast<double>(ns);
  BodyState state;
  state.position = {0.1 * std::cos(turn), 0.1 * std::sin(turn), 0};
  state.velocity = 3.14159265358979 * Vec3d{-state.position.y(), state.position.x(), 0};
  state.orientation = haptics::exp_map({0, 0, turn});
  state.angular_velocity = {0, 0, 3.14159265358979};
  return state;
}

TEST(PoseInterpolator, FollowsAMovingObjectCloselyAndWithoutJumps) {
  PoseInterpolator pose_interpolator{on_circle(0)};
  std::uint64_t number = 0;
  double furthest = 0, jump = 0;
  BodyState before = on_circle(0);
  for (std::int64_t ms = 0; ms < 2000; ++ms) {
    if (ms % 10 == 0 && ms >= 20)
      pose_interpolator.on_pose({on_circle((ms - 20) * kMs), (ms - 20) * kMs, ++number}, ms * kMs);
    const BodyState shown = pose_interpolator.state_at(ms * kMs);
    if (ms > 100) {
      furthest = std::max(furthest, (shown.position - on_circle(ms * kMs).position).norm());
      jump = std::max(jump, (shown.position - before.position).norm());
    }
    before = shown;
  }
  EXPECT_LT(furthest, 0.001) << "without extrapolation the delay would cause 9 mm";
  EXPECT_LT(jump, 0.0005) << "the object moves 0.31 mm in a millisecond";
}

TEST(PoseInterpolator, StopsWhenPosesStop) {
  PoseInterpolator pose_interpolator;
  pose_interpolator.on_pose({on_circle(0), 0, 1}, 0);
  const BodyState stopped = pose_interpolator.state_at(500 * kMs);
  EXPECT_TRUE(stopped.velocity.isZero());
  EXPECT_LT((stopped.position - on_circle(0).position).norm(), 0.02);
  EXPECT_EQ(stopped.position, pose_interpolator.state_at(900 * kMs).position);
}

TEST(PoseInterpolator, FadesFromTheShownPose) {
  PoseInterpolator pose_interpolator;
  BodyState here;
  here.position = {1, 2, 3};
  pose_interpolator.set_state(here, 100 * kMs);
  EXPECT_EQ(pose_interpolator.state_at(200 * kMs).position, here.position);
  BodyState there = here;
  there.position.x() += 0.01;
  pose_interpolator.on_pose({there, 200 * kMs, 1}, 200 * kMs);
  EXPECT_NEAR(pose_interpolator.state_at(200 * kMs).position.x(), 1, 1e-9) << "the difference is faded out";
  EXPECT_NEAR(pose_interpolator.state_at(700 * kMs).position.x(), 1.01, 1e-9);
}

}  // namespace
}  // namespace tactus::sharing
