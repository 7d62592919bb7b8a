#include "sharing/body.hpp"

#include <gtest/gtest.h>

namespace tactus::sharing {
namespace {

session::CatalogueEntry crate() {
  session::CatalogueEntry entry;
  entry.summary.bounds_min = {-1, 2, 0};
  entry.summary.bounds_max = {5, 4, 10};
  entry.scale = 0.01;
  entry.pose = {{0.5, -0.25, 1}, {0.5, -0.5, 0.5, 0.5}};
  entry.body = {0.8, inertia_of_bounds(entry.summary, entry.scale, 0.8), 0.6, -0.5};
  return entry;
}

BodyState moving() {
  BodyState state;
  state.position = {0.1, 0.2, 0.3};
  state.orientation = Eigen::Quaterniond{0.5, 0.1, -0.7, 0.2}.normalized();
  state.velocity = {0.01, -0.02, 0.03};
  state.angular_velocity = {1, -2, 0.5};
  return state;
}

TEST(SharedBody, HasTheInertiaOfItsBoxAboutTheCentreOfItsBounds) {
  const SharedBody body = body_of(crate());
  EXPECT_TRUE(body.centre.isApprox(Vec3d{0.02, 0.03, 0.05}));
  EXPECT_NEAR(body.settings.inertia.x(), 0.8 / 12 * (0.02 * 0.02 + 0.1 * 0.1), 1e-12);
  EXPECT_EQ(body.settings.point_count, 8u);
  for (std::uint32_t i = 0; i < body.settings.point_count; ++i)
    EXPECT_TRUE(body.settings.points[i].cwiseAbs().isApprox(Vec3d{0.03, 0.01, 0.05}));
  EXPECT_EQ(body.settings.friction, 0.6);
  EXPECT_EQ(body.ground, -0.5);
  session::CatalogueEntry fixed = crate();
  fixed.body.mass = 0;
  EXPECT_TRUE(can_move(crate()));
  EXPECT_FALSE(can_move(fixed));
}

TEST(SharedBody, AStateConvertedToAPoseAndBackIsUnchanged) {
  const SharedBody body = body_of(crate());
  session::ObjectPose pose;
  put_state(moving(), body.centre, pose);
  const BodyState back = state_of(pose, body.centre);
  EXPECT_TRUE(back.position.isApprox(moving().position, 1e-12));
  EXPECT_TRUE(back.orientation.isApprox(moving().orientation, 1e-12));
  EXPECT_TRUE(back.velocity.isApprox(moving().velocity, 1e-12));
  EXPECT_TRUE(back.angular_velocity.isApprox(moving().angular_velocity, 1e-12));
  const session::Pose pose_back = pose_of(state_at(crate().pose, body.centre), body.centre);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(pose_back.position[i], crate().pose.position[i], 1e-12);
}

TEST(SharedBody, ThePublishedVelocityIsThatOfTheOriginOfTheModel) {
  constexpr double kDt = 1e-6;
  const Vec3d centre{0.3, -0.1, 0.2};
  session::ObjectPose now, later;
  put_state(moving(), centre, now);
  put_state(extrapolated(moving(), kDt), centre, later);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_NEAR((later.pose.position[i] - now.pose.position[i]) / kDt, now.velocity[i], 1e-5);
}

TEST(SharedBody, ACopySampleConvertedToATopicSampleAndBackIsUnchanged) {
  haptics::CopySample sample;
  sample.time_ns = 1234567;
  sample.body = moving();
  sample.user_force = {1, -2, 3};
  for (std::size_t i = 0; i < 3; ++i) {
    sample.waves[i].setConstant(0.5 + static_cast<double>(i));
    sample.energy[i] = 0.25 * static_cast<double>(i);
  }
  session::ObjectCopy copy;
  put_sample(sample, 3, copy);
  EXPECT_EQ(copy.channels.size(), 3u);
  const haptics::CopySample back = sample_of(copy);
  EXPECT_EQ(back.time_ns, sample.time_ns);
  EXPECT_TRUE(back.body.position.isApprox(sample.body.position));
  EXPECT_TRUE(back.body.orientation.isApprox(sample.body.orientation));
  EXPECT_TRUE(back.body.velocity.isApprox(sample.body.velocity));
  EXPECT_TRUE(back.body.angular_velocity.isApprox(sample.body.angular_velocity));
  EXPECT_EQ(back.user_force, sample.user_force);
  EXPECT_EQ(back.waves, sample.waves);
  EXPECT_EQ(back.energy, sample.energy);
}

}  // namespace
}  // namespace tactus::sharing
