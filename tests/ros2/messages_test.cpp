// What the topics carry for a probe state and for a mesh.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "ros2/publisher.hpp"
#include "session/units.hpp"

namespace tactus::ros2 {
namespace {

using testing::DoubleEq;
using testing::ElementsAre;

session::ProbeState moving_probe() {
  session::ProbeState state;
  state.session_time_ns = 1000 * kMs;
  state.device.position = {0.1, 0.2, 0.3};
  state.device.orientation = {0, 0, 0.6, 0.8};
  state.proxy = {0.4, 0.5, 0.6};
  state.velocity = {1, 0, 0};
  return state;
}

TEST(Ros2MessagesTest, ADeviceIsExtrapolatedByItsVelocity) {
  const UserMessages messages = messages_of(moving_probe(), 1010 * kMs, {});
  EXPECT_THAT(messages.device.pose.position, ElementsAre(DoubleEq(0.11), 0.2, 0.3));
  EXPECT_THAT(messages.device.pose.orientation, ElementsAre(0, 0, 0.6, 0.8));
  EXPECT_THAT(messages.twist.linear, ElementsAre(1, 0, 0));
}

TEST(Ros2MessagesTest, AForceThatIsOffStaysOff) {
  session::ProbeState state = moving_probe();
  state.status = session::kInContact;
  state.stiffness = 1000;
  EXPECT_THAT(messages_of(state, 1010 * kMs, {}).wrench.force, ElementsAre(0, 0, 0));
}

TEST(Ros2MessagesTest, EachMessageHasTheHeader) {
  const UserMessages messages =
      messages_of(moving_probe(), 1000 * kMs, {Time::from_ns(1'700'000'000'500'000'000), "lab"});
  for (const Header* header :
       {&messages.wrench.header, &messages.device.header, &messages.proxy.header, &messages.twist.header}) {
    EXPECT_EQ(header->frame_id, "lab");
    EXPECT_EQ(header->stamp.sec, 1'700'000'000);
    EXPECT_EQ(header->stamp.nanosec, 500'000'000u);
  }
}

TEST(Ros2MessagesTest, TheFrameOfAnObjectHasAValidName) {
  session::CatalogueEntry entry;
  entry.object = "old crate";
  EXPECT_EQ(frame_of(entry), "tactus/oldqx_20crate");
}

TEST(Ros2MessagesTest, AMarkerOfAnObjectWithoutFacesHasNoPoints) {
  viewer::SeenObject object;
  object.entry.scale = 0.01;
  const Marker marker = marker_of(object, "tactus/organ");
  EXPECT_EQ(marker.ns, "tactus/organ");
  EXPECT_THAT(marker.scale, ElementsAre(0.01, 0.01, 0.01));
  EXPECT_TRUE(marker.points.empty());
}

}  // namespace
}  // namespace tactus::ros2
