/// Users near one object receive full-rate states of each other; the session receives deadband-coded states.
#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;

class ModesTest : public SessionTest {};

constexpr char kTwoAtOne[] = R"(name: two at one object
duration: 120
users:
  - name: ann
    hrtc: desk1
    script: [{approach: {object: "#1", direction: [0, 0, 1], speed: 0.2}}, {hold: {seconds: 110, force: 1}}]
  - name: bob
    hrtc: desk2
    script: [{approach: {object: "#1", direction: [0, 0.5, 1], speed: 0.2}}, {hold: {seconds: 110, force: 1}}]
)";

/// True if `count` users of each HRTC collaborate now.
bool collaborate(const Seen& seen, double count) {
  return seen.figure("desk1", figures::kCollaborating) == count &&
         seen.figure("desk2", figures::kCollaborating) == count;
}

TEST_F(ModesTest, UsersAtOneObjectCollaborateUntilAModeIsCommandedAndTheSessionReceivesCodedStates) {
  Observer observer{address("observer")};
  wire::Writer<session::Control> control{observer.participants(), wire::topics::kControl};
  Process museum{host("museum", models().sphere)};
  Process desk1{coding_hrtc("desk1")};
  Process desk2{coding_hrtc("desk2")};
  Process users{sim(kTwoAtOne)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return collaborate(seen, 1); }))
      << users.output() << desk1.output() << desk2.output();
  const Seen collaborating = observer.seen();
  ASSERT_TRUE(observer.until([&](const Seen& seen) {
    return seen.figure("desk1", figures::kStatesFullRate) > collaborating.figure("desk1", figures::kStatesFullRate) &&
           seen.figure("desk2", figures::kStatesFullRate) > collaborating.figure("desk2", figures::kStatesFullRate) &&
           seen.user("ann").exact > 0 && seen.user("bob").exact > 0;
  }));
  const Seen touching = observer.seen();
  EXPECT_LT(touching.figure("desk1", figures::kStatesDeadbandCoded), touching.figure("desk1", figures::kCycles) / 2);

  session::Control command;
  command.origin = observer.participants().origin();
  command.sequence = 1;
  command.kind = session::ControlKind::kMode;
  command.text = "large-scale";
  ASSERT_EQ(control.send(command), wire::SendStatus::kSent);
  EXPECT_TRUE(desk1.wait_for_line("mode: large-scale"));
  EXPECT_TRUE(observer.until([](const Seen& seen) { return collaborate(seen, 0); }));
  observer.forget_states();
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 0 && seen.user("bob").exact > 0; }))
      << "both still send states of exact contact";
  users.signal(SIGINT);
  EXPECT_TRUE(exits_with(1, users));
  EXPECT_TRUE(exits_with(0, desk1));
  EXPECT_TRUE(exits_with(0, desk2));
  EXPECT_TRUE(exits_with(0, museum));
}

}  // namespace
}  // namespace tactus::e2e
