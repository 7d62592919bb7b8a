/// A session with a program that uses another implementation of DDS.
#include "tests/e2e/session_test.hpp"

#ifndef TACTUS_CYCLONE_DEVICE
#define TACTUS_CYCLONE_DEVICE ""
#endif

namespace tactus::e2e {
namespace {

using Seen = Observer::Seen;

class CycloneTest : public SessionTest {};

TEST_F(CycloneTest, AClientOnCycloneDdsReadsTheSessionAndBringsADeviceThatReceivesForces) {
  if (*TACTUS_CYCLONE_DEVICE == '\0') GTEST_SKIP() << "no Cyclone DDS (Debian: cyclonedds-dev, cyclonedds-tools)";
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process carl{{TACTUS_CYCLONE_DEVICE, session_, std::to_string(domain_.first()), "desk", "sphere"}};
  for (const char* line :
       {"participant: museum", "participant: desk", "object: sphere of museum, 20000 faces", "probe: 0 of desk",
        "clock: synchronised", "shown: sphere by desk", "received force: .* N upwards", "probe state: probe 0 at z"}) {
    EXPECT_TRUE(carl.wait_for_line(line)) << line << "\n" << carl.output() << desk.output();
  }
  EXPECT_TRUE(desk.wait_for_line("user carl has a remote device")) << desk.output();
  EXPECT_TRUE(observer.until([](const Seen& seen) {
    const StateCounts state = seen.user("carl");
    // The client's bound is 0.5 N. The force may fall later, because a longer round trip reduces the stiffness.
    return seen.is_present("cyclone") && state.exact > 100 && state.last.force[2] > 0.05;
  })) << carl.output();
  const session::RosterEntry entry = observer.seen().roster.at("cyclone");
  EXPECT_EQ(entry.role, session::Role::kClient);
  EXPECT_THAT(entry.users, testing::ElementsAre("carl"));

  wire::Writer<session::SessionEnd> end{observer.participants(), wire::topics::kEnd};
  ASSERT_EQ(end.send({observer.participants().origin(), "enough"}), wire::SendStatus::kSent);
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.has_left("cyclone"); })) << carl.output();
  EXPECT_EQ(carl.wait(), 0) << carl.output();
  EXPECT_EQ(desk.wait(), 0);
  EXPECT_EQ(museum.wait(), 0);
}

}  // namespace
}  // namespace tactus::e2e
