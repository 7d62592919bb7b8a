/// Watches sessions with tactus-watch and tactus-top.
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>

#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

using nlohmann::json;
using Seen = Observer::Seen;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Key;
using testing::Not;

constexpr char kWatchedTouch[] = R"(name: long touch
duration: 120
users:
  - name: ann
    script: [{approach: {object: "#1", speed: 0.2}}, {hold: {seconds: 110, force: 1}}]
)";

/// A session in which user ann touches a sphere.
class TerminalTest : public SessionTest {
 protected:
  [[nodiscard]] bool wait_for_touch() {
    return observer_.until([](const Seen& seen) { return seen.user("ann").exact > 50; });
  }
  Observer observer_{address("observer")};
  Process museum_{host("museum", models().sphere)};
  Process desk_{coding_hrtc("desk")};
  Process users_{sim(kWatchedTouch)};
};

TEST_F(TerminalTest, WatchPrintsTheSamplesOfAUserAsLinesOfJson) {
  ASSERT_TRUE(wait_for_touch()) << users_.output();
  Process watch{in_session("watch", {"probe_state", "--json", "--user", "ann", "--from", "desk", "--count", "20"})};
  ASSERT_TRUE(exits_with(0, watch));
  std::istringstream output{watch.output()};
  int lines = 0, lines_in_contact = 0;
  std::uint64_t last_number = 0;
  for (std::string line; std::getline(output, line); ++lines) {
    ASSERT_TRUE(json::accept(line)) << line;
    const json row = json::parse(line);
    const json& sample = row["sample"];
    EXPECT_EQ(row["topic"], "tactus_probe_state");
    EXPECT_EQ(sample["user_id"], "ann");
    EXPECT_EQ(sample["participant"], "desk");
    EXPECT_EQ(sample["stamp"]["session"], session_);
    if (sample["object_id"] == "sphere" && sample["status"][0] == "kInContact") ++lines_in_contact;
    EXPECT_GT(sample["sequence_number"].get<std::uint64_t>(), last_number);
    last_number = sample["sequence_number"];
  }
  EXPECT_EQ(lines, 20);
  EXPECT_GT(lines_in_contact, 0) << watch.output();
}

TEST_F(TerminalTest, WatchPrintsTextWithAFieldOnEachLine) {
  Process watch{in_session("watch", {"tactus_metrics", "--from", "desk", "--count", "1"})};
  ASSERT_TRUE(exits_with(0, watch));
  EXPECT_THAT(watch.output(), AllOf(HasSubstr("--- tactus_metrics, "), HasSubstr("\nparticipant: desk\n"),
                                    HasSubstr("\nfigures.hrtc.cycles: ")));
}

TEST_F(TerminalTest, WatchPrintsTheSamplesOfATimeThatIsShorterThanItsWaitForNames) {
  ASSERT_TRUE(wait_for_touch()) << users_.output();
  // On a busy machine, the discovery can take longer than one such time.
  std::string output;
  for (int i = 0; i < 20 && output.find("--- tactus_probe_state, ") == std::string::npos; ++i) {
    Process watch{in_session("watch", {"probe_state", "--for", "0.5"})};
    (void)watch.wait();
    output = watch.output();
  }
  EXPECT_THAT(output, HasSubstr("--- tactus_probe_state, "));
}

TEST_F(TerminalTest, WatchReportsThatNoSampleArrived) {
  Process watch{in_session("watch", {"reset", "--for", "1"})};
  EXPECT_TRUE(exits_with(1, watch));
  EXPECT_THAT(watch.output(), HasSubstr("found 0 samples, expected at least 1 of tactus_reset in session " + session_));
}

TEST_F(TerminalTest, TopShowsTheSessionOnce) {
  ASSERT_TRUE(wait_for_touch()) << users_.output();
  Process top{in_session("top", {"--once", "--interval", "2"})};
  ASSERT_TRUE(exits_with(0, top));
  const std::string screen = top.output();
  EXPECT_THAT(screen, AllOf(HasSubstr(": 1 host, 1 HRTC, 1 client, 0 viewers\n"), Not(HasSubstr("\x1b"))));
  EXPECT_TRUE(std::regex_search(screen, std::regex{"\nann +desk +0 +[0-9]+ +[0-9]+ +[0-9.]+ +sphere .*kInContact"}))
      << screen;
  EXPECT_TRUE(std::regex_search(screen, std::regex{"\ndesk +(ok|late) +[0-9]+ +[0-9]+ "})) << screen;
  EXPECT_TRUE(std::regex_search(screen, std::regex{"\nmuseum +(ok|late) +[0-9]+ +1 +1 "})) << screen;
}

TEST_F(TerminalTest, TopShowsAStopAndAProgramThatFell) {
  ASSERT_TRUE(wait_for_touch()) << users_.output();
  Process top{in_session("top", {})};
  ASSERT_TRUE(top.wait_for_line("^ann +desk .*kInContact")) << top.output();
  Process stop{in_session("control", {"stop", "--reason", "needle bent"})};
  EXPECT_TRUE(exits_with(0, stop));
  EXPECT_TRUE(top.wait_for_line("^EMERGENCY STOP: forces are off at desk")) << top.output();
  EXPECT_TRUE(top.wait_for_line("^reason: needle bent")) << top.output();
  EXPECT_TRUE(top.wait_for_line("^ann .*FAULT: emergency stop")) << top.output();
  museum_.signal(SIGKILL);
  EXPECT_TRUE(top.wait_for_line("^museum +gone for")) << top.output();
}

TEST_F(TerminalTest, ObserversAreNoParticipants) {
  Process top{in_session("top", {})};
  Process watch{in_session("watch", {"roster"})};
  ASSERT_TRUE(top.wait_for_line("^desk +ok"));
  ASSERT_TRUE(watch.wait_for_line("name: desk"));
  ASSERT_TRUE(wait_for_touch()) << users_.output();
  EXPECT_THAT(observer_.seen().roster, ElementsAre(Key("desk"), Key("museum"), Key("sim")));
}

class EverySignalToTheTerminal : public SessionTest, public testing::WithParamInterface<int> {};
INSTANTIATE_TEST_SUITE_P(Signals, EverySignalToTheTerminal, testing::Values(SIGINT, SIGTERM),
                         [](const auto& signal) { return std::string{signal.param == SIGINT ? "SIGINT" : "SIGTERM"}; });

TEST_P(EverySignalToTheTerminal, EndsWatchAndTopWithStatus130) {
  Process watch{in_session("watch", {"roster"})};
  Process top{in_session("top", {})};
  ASSERT_TRUE(watch.wait_for_line("no sample yet of tactus_roster")) << watch.output();
  ASSERT_TRUE(top.wait_for_line("no participants")) << top.output();
  watch.signal(GetParam());
  top.signal(GetParam());
  EXPECT_TRUE(exits_with(130, watch));
  EXPECT_TRUE(exits_with(130, top));
}

class EmptySessionTest : public SessionTest {};

TEST_F(EmptySessionTest, HasNoScreenWithTopOnce) {
  Process top{in_session("top", {"--once", "--patience", "0.2"})};
  EXPECT_TRUE(exits_with(1, top));
  EXPECT_THAT(top.output(), HasSubstr("found no participant in session " + session_));
}

}  // namespace
}  // namespace tactus::e2e
