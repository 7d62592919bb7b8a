/// The emergency stop as an operator gives it, and what everyone is told of it.
#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;

class SafetyTest : public SessionTest {
 protected:
  [[nodiscard]] std::vector<std::string> control(std::vector<std::string> arguments) const {
    return in_session("control", std::move(arguments));
  }
};

constexpr char kTwoHold[] = R"(name: two hold
duration: 120
users:
  - name: ann
    hrtc: desk
    script: [{approach: {object: "#1", direction: [0, 0, 1], speed: 0.2}}, {hold: {seconds: 110, force: 1}}]
  - name: bob
    hrtc: desk
    script: [{approach: {object: "#1", direction: [0, 1, 0], speed: 0.2}}, {hold: {seconds: 110, force: 1}}]
)";

bool feels(const Seen& seen, const std::string& user) {
  const session::ProbeState state = seen.user(user).last;
  return std::hypot(state.force[0], state.force[1], state.force[2]) > 0.1;
}

bool is_off(const Seen& seen, const std::string& user) {
  const session::ProbeState state = seen.user(user).last;
  return std::string{session::fault_reason(state.status)} == "emergency stop" && !feels(seen, user);
}

TEST_F(SafetyTest, AStopTakesEveryForceAndSaysWhyUntilAReset) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{sim(kTwoHold)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return feels(seen, "ann") && feels(seen, "bob"); }))
      << users.output() << desk.output();

  Process stop{control({"stop", "--reason", "needle bent"})};
  EXPECT_TRUE(observer.until([](const Seen& seen) { return is_off(seen, "ann") && is_off(seen, "bob"); }));
  EXPECT_TRUE(desk.wait_for_line("emergency stop: needle bent"));
  EXPECT_TRUE(desk.wait_for_line("the force of user ann is off until it is reset: emergency stop"));
  EXPECT_TRUE(ends_with(0, stop)) << stop.output();
  EXPECT_THAT(stop.output(), testing::HasSubstr("HRTCs: desk"));
  EXPECT_TRUE(observer.until([](const Seen& seen) { return seen.figure("desk", figures::kInterventions[6]) == 2; }));

  Process reset{control({"reset", "--reason", "straight again"})};
  EXPECT_TRUE(observer.until([](const Seen& seen) { return feels(seen, "ann") && feels(seen, "bob"); }));
  EXPECT_TRUE(ends_with(0, reset)) << reset.output();

  Process end{control({"end", "--reason", "enough"})};
  EXPECT_TRUE(ends_with(1, users));
  EXPECT_TRUE(ends_with(0, end)) << end.output();
  EXPECT_THAT(users.output(), testing::HasSubstr("the force of ann is off: emergency stop"));
  EXPECT_THAT(users.output(), testing::HasSubstr("FAULT 2"));
}

TEST_F(SafetyTest, AStopHoldsForAnHrtcThatStartsAfterItUntilAReset) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process stop{control({"stop", "--reason", "needle bent"})};
  ASSERT_TRUE(ends_with(1, stop)) << "no HRTC was there, and it says so: " << stop.output();

  Process desk{hrtc("desk")};  // only the host can tell it
  ASSERT_TRUE(desk.wait_for_line("host 'museum' says that the session is stopped"));
  Process users{sim(kTwoHold)};
  EXPECT_TRUE(observer.until([](const Seen& seen) { return is_off(seen, "ann") && is_off(seen, "bob"); }))
      << users.output() << desk.output();
  museum.signal(SIGKILL);
  Process gallery{host("gallery", models().sphere)};  // only the HRTC can tell it
  ASSERT_TRUE(gallery.wait_for_line("HRTC 'desk' says that the session is stopped"));

  Process reset{control({"reset"})};
  EXPECT_TRUE(observer.until([](const Seen& seen) { return feels(seen, "ann") && feels(seen, "bob"); }))
      << users.output() << desk.output();
  Process table{hrtc("table")};
  EXPECT_TRUE(table.wait_for_line("HRTC 'desk' joined"));
  EXPECT_THAT(table.output(), testing::Not(testing::HasSubstr("stopped")));
}

TEST_F(SafetyTest, AStopThatNobodyHearsFails) {
  Process stop{control({"stop", "--patience", "0.2"})};
  EXPECT_TRUE(ends_with(1, stop));
  EXPECT_THAT(stop.output(), testing::HasSubstr("nobody was found in session"));
}

}  // namespace
}  // namespace tactus::e2e
