#include "sharing/pointed_hand.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tactus::sharing {
namespace {

using testing::DoubleNear;
using testing::ElementsAre;

constexpr std::int64_t kMs = 1'000'000;

TEST(PointedHandTest, BeginsAtTheFirstTarget) {
  PointedHand hand;
  const session::Intent intent = hand.move_to({0.1, 0.2, 0.3}, 1000 * kMs);
  ASSERT_EQ(intent.path.size(), 2u);
  EXPECT_THAT(intent.path[0].pose.position, ElementsAre(0.1, 0.2, 0.3));
  EXPECT_THAT(intent.path[1].pose.position, ElementsAre(0.1, 0.2, 0.3));
  EXPECT_LT(intent.path[0].session_time_ns, intent.path[1].session_time_ns);
}

TEST(PointedHandTest, MovesToTheTargetWithItsSpeed) {
  PointedHand hand;
  (void)hand.move_to({0, 0, 0}, 0);
  const session::Intent intent = hand.move_to({0, 0, 0.1}, 100 * kMs);
  EXPECT_EQ(intent.path[0].session_time_ns, 100 * kMs);
  EXPECT_EQ(intent.path[1].session_time_ns, 300 * kMs);  // 0.1 m at 0.5 m/s
}

TEST(PointedHandTest, ANewTargetDuringAMotionContinuesFromThePresentPosition) {
  PointedHand hand;
  (void)hand.move_to({0, 0, 0}, 0);
  (void)hand.move_to({0, 0, 0.1}, 100 * kMs);  // until 300 ms
  const session::Intent intent = hand.move_to({0.2, 0, 0}, 150 * kMs);
  EXPECT_THAT(intent.path[0].pose.position, ElementsAre(0, 0, DoubleNear(0.025, 1e-9)));
  EXPECT_THAT(intent.path[1].pose.position, ElementsAre(0.2, 0, 0));
}

TEST(PointedHandTest, RestsAtTheTargetAfterTheMotion) {
  PointedHand hand;
  (void)hand.move_to({0, 0, 0}, 0);
  (void)hand.move_to({0, 0, 0.1}, 0);
  EXPECT_THAT(hand.move_to({0, 0, 0}, 5000 * kMs).path[0].pose.position, ElementsAre(0, 0, 0.1));
}

TEST(PointedHandTest, RotatesToTheOrientationOfTheTarget) {
  PointedHand hand;
  (void)hand.move_to({{0, 0, 0}, {0, 0, 0, 1}}, 0);
  const double half = std::sqrt(0.5);
  (void)hand.move_to({{0, 0, 0.1}, {0, 0, -half, -half}}, 0);  // 90 degrees about z, until 200 ms; -q is the same as q
  const session::Intent intent = hand.move_to({0, 0, 0.1}, 100 * kMs);
  EXPECT_THAT(intent.path[0].pose.orientation,
              ElementsAre(0, 0, DoubleNear(std::sin(M_PI / 8), 1e-9), DoubleNear(std::cos(M_PI / 8), 1e-9)));
}

}  // namespace
}  // namespace tactus::sharing
