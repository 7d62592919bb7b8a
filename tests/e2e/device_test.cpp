/// An HRTC loads a device driver: the example of docs/how-to/own-device.md, a weight that lies on a surface.
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

using Seen = Observer::Seen;

/// The weights start so high that on a busy machine, too, the object is there before they would fall through it.
class DeviceTest : public SessionTest {};

TEST_F(DeviceTest, TheForceOnAWeightAtRestEqualsItsWeight) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk", {"--device", "ann=" TACTUS_EXAMPLE_WEIGHT ",0.6"})};
  EXPECT_TRUE(desk.wait_for_line("device weight in oil"));
  EXPECT_TRUE(observer.until([](const Seen& seen) {
    const StateCounts ann = seen.user("ann");
    return ann.exact > 100 && std::abs(ann.last.force[2] - 0.981) < 1e-3 && std::abs(ann.last.velocity[2]) < 1e-3;
  })) << desk.output();
  desk.signal(SIGINT);
  EXPECT_TRUE(exits_with(0, desk));
}

TEST_F(DeviceTest, ADriverThatIsKilledEndsTheForceOfItsUserAlone) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk", {"--device", "ann=" TACTUS_EXAMPLE_WEIGHT ",0.6", "--device",
                             "bob=" TACTUS_EXAMPLE_WEIGHT ",0.5", "--users", "2"})};
  const auto rests = [](const Seen& seen, const char* user) {
    return std::abs(seen.user(user).last.force[2] - 0.981) < 1e-3;
  };
  ASSERT_TRUE(observer.until([&](const Seen& seen) { return rests(seen, "ann") && rests(seen, "bob"); }))
      << desk.output();
  ::kill(desk.child("tactus-device"), SIGKILL);  // of ann, which was opened first
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").faults > 0; })) << desk.output();
  observer.forget_states();
  ASSERT_TRUE(observer.until([&](const Seen& seen) { return seen.user("bob").exact > 100 && rests(seen, "bob"); }))
      << desk.output();
  const Seen seen = observer.seen();
  EXPECT_EQ(seen.user("bob").faults, 0u);
  EXPECT_EQ(seen.user("ann").last.force, (std::array<double, 3>{}));
  desk.signal(SIGINT);
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_THAT(desk.output(),
              testing::HasSubstr("user ann: device weight in oil: the process of its driver was killed"));
}

TEST_F(DeviceTest, ADeviceThatCannotBeOpenedIsWrongInput) {
  Process no_file{hrtc("desk", {"--device", "ann=/nowhere/driver.so"})};
  EXPECT_TRUE(exits_with(2, no_file));
  EXPECT_THAT(no_file.output(), testing::HasSubstr("/nowhere/driver.so: cannot open shared object file"));
  Process no_height{hrtc("desk", {"--device", "ann=" TACTUS_EXAMPLE_WEIGHT ",high"})};
  EXPECT_TRUE(exits_with(2, no_height));
  EXPECT_THAT(no_height.output(), testing::HasSubstr("found 'high', expected a height in metres"));
  Process no_driver{hrtc("desk", {"--device", "ann"})};
  EXPECT_TRUE(exits_with(2, no_driver));
  EXPECT_THAT(no_driver.output(), testing::HasSubstr("found ann, expected USER=DRIVER[,CONFIG]"));
}

}  // namespace
}  // namespace tactus::e2e
