/// Ctrl-C and SIGTERM, whatever a program is doing.
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
  static bool has_left(Observer& observer, const std::string& name) {
    return observer.until([&](const Seen& seen) { return seen.has_left(name); });
  }
};

INSTANTIATE_TEST_SUITE_P(Signals, EverySignal, testing::Values(SIGINT, SIGTERM),
                         [](const auto& signal) { return std::string{signal.param == SIGINT ? "SIGINT" : "SIGTERM"}; });

TEST_P(EverySignal, EndsProgramsThatWaitForOthers) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_here("museum"); }));
  museum.signal(GetParam());
  EXPECT_TRUE(ends_with(0, museum));
  EXPECT_TRUE(has_left(observer, "museum"));

  Process desk{hrtc("desk")};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_here("desk"); }));
  desk.signal(GetParam());
  EXPECT_TRUE(ends_with(0, desk));
  EXPECT_TRUE(has_left(observer, "desk"));

  Process users{in_session("sim", {"--scenario", "touch"})};
  ASSERT_TRUE(users.wait_for_line("no HRTC #1"));
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_here("sim"); }));
  users.signal(GetParam());
  EXPECT_TRUE(ends_with(1, users));
  EXPECT_TRUE(has_left(observer, "sim"));
  EXPECT_THAT(users.output(), HasSubstr("Stopped early: interrupted"));
}

TEST_P(EverySignal, EndsProgramsInTheMiddleOfASession) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk", {"--log", path("desk.log")})};
  Process users{in_session("sim", {"--scenario", "follow", "--json", path("report.json")})};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 100; })) << users.output();

  museum.signal(GetParam());
  EXPECT_TRUE(ends_with(0, museum));
  EXPECT_TRUE(has_left(observer, "museum"));
  observer.forget_states();
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").count > 100; })) << "without its host";
  desk.signal(GetParam());
  EXPECT_TRUE(ends_with(0, desk));
  EXPECT_TRUE(has_left(observer, "desk"));
  ASSERT_TRUE(users.running());
  users.signal(GetParam());
  EXPECT_TRUE(ends_with(1, users));
  EXPECT_TRUE(has_left(observer, "sim"));
  EXPECT_THAT(users.output(), HasSubstr("Stopped early: interrupted"));
  EXPECT_THAT(test_support::read_bytes(path("report.json")), HasSubstr("\"stop_reason\": \"interrupted\""));
}

TEST_P(EverySignal, ToTheUsersEndsTheWholeSession) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().sphere)};
  Process desk{hrtc("desk")};
  Process users{in_session("sim", {"--scenario", "follow"})};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.user("ann").exact > 100; })) << users.output();

  users.signal(GetParam());

  EXPECT_TRUE(ends_with(1, users));
  EXPECT_TRUE(ends_with(0, desk));
  EXPECT_TRUE(ends_with(0, museum));
  EXPECT_THAT(users.output(), HasSubstr("Stopped early: interrupted"));
  EXPECT_THAT(users.output(), HasSubstr("HRTC desk"));
}

TEST_P(EverySignal, EndsAHostThatStillBuildsItsModelAndNothingIsHalfWritten) {
  Process make{program("mesh", {"generate", "organ", path("large.ply"), "--faces", "400000"})};
  ASSERT_EQ(make.wait(60s), 0) << make.output();
  for (const std::string stage : {"building", "simplify", "divide"}) {
    Process museum{host("museum", path("large.ply"))};
    ASSERT_TRUE(museum.wait_for_line("large.ply: " + stage, 60s)) << museum.output();
    museum.signal(GetParam());
    EXPECT_TRUE(ends_with(0, museum)) << stage;
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
