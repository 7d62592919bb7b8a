/// SIGINT (Ctrl-C) and SIGTERM end a program in every phase of a session.
#include <filesystem>
#include <set>

#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

using Seen = Observer::Seen;
using testing::HasSubstr;
using testing::Not;

class EverySignal : public SessionTest, public testing::WithParamInterface<int> {
 protected:
  static bool wait_for_leave(Observer& observer, const std::string& name) {
    return observer.until([&](const Seen& seen) { return seen.has_left(name); });
  }
};

INSTANTIATE_TEST_SUITE_P(Signals, EverySignal, testing::Values(SIGINT, SIGTERM),
                         [](const auto& signal) { return std::string{signal.param == SIGINT ? "SIGINT" : "SIGTERM"}; });

TEST_P(EverySignal, EndsProgramsThatWaitForOthers) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("museum"); }));
  museum.signal(GetParam());
  EXPECT_TRUE(exits_with(0, museum));
  EXPECT_TRUE(wait_for_leave(observer, "museum"));

  Process desk{hrtc("desk")};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("desk"); }));
  desk.signal(GetParam());
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_TRUE(wait_for_leave(observer, "desk"));

  Process users{in_session("sim", {"--scenario", "touch"})};
  ASSERT_TRUE(users.wait_for_line("no HRTC #1"));
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("sim"); }));
  users.signal(GetParam());
  EXPECT_TRUE(exits_with(1, users));
  EXPECT_TRUE(wait_for_leave(observer, "sim"));
  EXPECT_THAT(users.output(), HasSubstr("Stopped early: interrupted"));
}

TEST_P(EverySignal, EndsProgramsInTheMiddleOfASession) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk", {"--log", path("desk.log")})};
  Process users{in_session("sim", {"--scenario", "follow", "--json", path("report.json")})};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 100; })) << users.output();

  museum.signal(GetParam());
  EXPECT_TRUE(exits_with(0, museum));
  EXPECT_TRUE(wait_for_leave(observer, "museum"));
  observer.forget_states();
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").count > 100; })) << "states without a host";
  desk.signal(GetParam());
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_TRUE(wait_for_leave(observer, "desk"));
  ASSERT_TRUE(users.running());
  users.signal(GetParam());
  EXPECT_TRUE(exits_with(1, users));
  EXPECT_TRUE(wait_for_leave(observer, "sim"));
  EXPECT_THAT(users.output(), HasSubstr("Stopped early: interrupted"));
  EXPECT_THAT(test_support::read_bytes(path("report.json")), HasSubstr("\"stop_reason\": \"interrupted\""));
}

TEST_P(EverySignal, ToTheSimulationEndsTheWholeSession) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{in_session("sim", {"--scenario", "follow"})};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 100; })) << users.output();

  users.signal(GetParam());

  EXPECT_TRUE(exits_with(1, users));
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_TRUE(exits_with(0, museum));
  EXPECT_THAT(users.output(), HasSubstr("Stopped early: interrupted"));
  EXPECT_THAT(users.output(), HasSubstr("HRTC desk"));
}

TEST_P(EverySignal, EndsAHostThatBuildsItsModelAndLeavesNoPartialFile) {
  Process mesh{program("mesh", {"generate", "organ", path("large.ply"), "--faces", "400000"})};
  ASSERT_EQ(mesh.wait(60s), 0) << mesh.output();
  for (const std::string stage : {"building", "simplify", "divide"}) {
    Process museum{host("museum", path("large.ply"))};
    ASSERT_TRUE(museum.wait_for_line("large.ply: " + stage, 60s)) << museum.output();
    museum.signal(GetParam());
    EXPECT_TRUE(exits_with(0, museum)) << stage;
    EXPECT_THAT(museum.output(), HasSubstr("stopped by a signal before all models were open")) << stage;
    EXPECT_THAT(museum.output(), Not(HasSubstr("stored in"))) << stage;
  }
  std::set<std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator{folder_.path()})
    if (entry.is_regular_file()) files.insert(entry.path().filename().string());
  EXPECT_THAT(files, testing::ElementsAre("large.ply"));
}

}  // namespace
}  // namespace tactus::e2e
