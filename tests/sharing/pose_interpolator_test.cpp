#include "sharing/pose_interpolator.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/constants.hpp"

namespace tactus::sharing {
namespace {

/// The state at time `ns` of a body that moves on a circle with a radius of 10 cm, once around in two seconds.
BodyState on_circle(std::int64_t ns) {
  const double angle = 3.14159265358979 * 1e-9 * static_cast<double>(ns);
  BodyState state;
  state.position = {0.1 * std::cos(angle), 0.1 * std::sin(angle), 0};
  state.velocity = 3.14159265358979 * Vec3d{-state.position.y(), state.position.x(), 0};
  state.orientation = haptics::exp_map({0, 0, angle});
  state.angular_velocity = {0, 0, 3.14159265358979};
  return state;
}

TEST(PoseInterpolator, ShowsAMovingObjectWithin1MmAndWithoutJumps) {
  PoseInterpolator pose_interpolator{on_circle(0)};
  std::uint64_t number = 0;
  double max_error = 0, max_step = 0;
  BodyState last = on_circle(0);
  for (std::int64_t ms = 0; ms < 2000; ++ms) {
    if (ms % 10 == 0 && ms >= 20)
      pose_interpolator.on_pose({on_circle((ms - 20) * kMs), (ms - 20) * kMs, ++number}, ms * kMs);
    const BodyState shown = pose_interpolator.state_at(ms * kMs);
    if (ms > 100) {
      max_error = std::max(max_error, (shown.position - on_circle(ms * kMs).position).norm());
      max_step = std::max(max_step, (shown.position - last.position).norm());
    }
    last = shown;
  }
  EXPECT_LT(max_error, 0.001) << "m; without extrapolation the error is 9 mm";
  EXPECT_LT(max_step, 0.0005) << "m; the object moves 0.31 mm in a millisecond";
}

TEST(PoseInterpolator, StopsWhenNoPosesArrive) {
  PoseInterpolator pose_interpolator;
  pose_interpolator.on_pose({on_circle(0), 0, 1}, 0);
  const BodyState stopped = pose_interpolator.state_at(500 * kMs);
  EXPECT_TRUE(stopped.velocity.isZero());
  EXPECT_LT((stopped.position - on_circle(0).position).norm(), 0.02);
  EXPECT_EQ(stopped.position, pose_interpolator.state_at(900 * kMs).position);
}

TEST(PoseInterpolator, MovesSmoothlyFromTheShownPoseToANewPose) {
  PoseInterpolator pose_interpolator;
  BodyState first;
  first.position = {1, 2, 3};
  pose_interpolator.set_state(first, 100 * kMs);
  EXPECT_EQ(pose_interpolator.state_at(200 * kMs).position, first.position);
  BodyState second = first;
  second.position.x() += 0.01;
  pose_interpolator.on_pose({second, 200 * kMs, 1}, 200 * kMs);
  EXPECT_NEAR(pose_interpolator.state_at(200 * kMs).position.x(), 1, 1e-9) << "the difference is faded out";
  EXPECT_NEAR(pose_interpolator.state_at(700 * kMs).position.x(), 1.01, 1e-9);
}

}  // namespace
}  // namespace tactus::sharing
