#include "ros2/targets.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace tactus::ros2 {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

PoseStamped target() {
  PoseStamped made;
  made.header.frame_id = "world";
  return made;
}

TEST(Ros2TargetsTest, ATopicOfTargetPosesNamesItsUser) {
  EXPECT_EQ(target_user("rt/tactus/guest/target_pose"), "guest");
  EXPECT_EQ(target_user("rt/tactus/viewqx_2eguest/target_pose"), "view.guest");
}

TEST(Ros2TargetsTest, OtherTopicsNameNoUser) {
  for (const char* topic : {"rt/tactus//target_pose", "rt/tactus/target_pose", "rt/tactus/guest/pose",
                            "rt/other/guest/target_pose", "rt/tactus/a/b/target_pose", "tactus/guest/target_pose", ""})
    EXPECT_EQ(target_user(topic), std::nullopt) << topic;
}

TEST(Ros2TargetsTest, APoseInTheWorldFrameHasNoFault) { EXPECT_THAT(fault_of(target(), "world"), IsEmpty()); }

TEST(Ros2TargetsTest, APoseInAnotherFrameHasAFault) {
  EXPECT_EQ(fault_of(target(), "map"), "found frame 'world', expected 'map'");
}

TEST(Ros2TargetsTest, AFaultContainsNoControlCharacterOfAFrame) {
  PoseStamped other = target();
  other.header.frame_id = "a\n\x1b[2J\x7f\xc2\x9b";
  EXPECT_EQ(fault_of(other, "world"), "found frame 'a?\?[2J?\?', expected 'world'");
}

TEST(Ros2TargetsTest, APositionThatIsFarOrNotFiniteIsAFault) {
  for (const double x : {101.0, -101.0, std::numeric_limits<double>::quiet_NaN()}) {
    PoseStamped far = target();
    far.pose.position[0] = x;
    EXPECT_THAT(fault_of(far, "world"), HasSubstr("position")) << x;
  }
}

TEST(Ros2TargetsTest, AnOrientationThatIsNoUnitQuaternionIsAFault) {
  for (const double w : {0.0, 2.0, std::numeric_limits<double>::quiet_NaN()}) {
    PoseStamped turned = target();
    turned.pose.orientation[3] = w;
    EXPECT_THAT(fault_of(turned, "world"), HasSubstr("orientation")) << w;
  }
}

}  // namespace
}  // namespace tactus::ros2
