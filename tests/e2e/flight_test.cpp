/// Flight recordings, which an HRTC writes after a stop, after a signal and at its end, and their replay.
#include <filesystem>

#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

using Seen = Observer::Seen;
using testing::HasSubstr;

class FlightTest : public SessionTest {
 protected:
  [[nodiscard]] std::vector<std::string> recordings() const {
    std::vector<std::string> files;
    for (const auto& entry : std::filesystem::directory_iterator{path("flight")}) files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    return files;
  }
  /// The output of the replay of `file`, which must exit with `status`.
  [[nodiscard]] static std::string replay_output(const std::string& file, int status, const std::string& model) {
    Process replay{program("replay", {file, "--model", model})};
    EXPECT_TRUE(exits_with(status, replay));
    return replay.output();
  }
};

constexpr char kTwoUsersFollow[] = R"(name: two follow
duration: 120
users:
  - name: ann
    script:
      - approach: {object: "#1", direction: [0, 0, 1], speed: 0.2}
      - follow: {speed: 0.1, force: 1, seconds: 110, pattern: circle}
  - name: bob
    remote: true
    script:
      - approach: {object: "#1", direction: [0, 1, 0], speed: 0.2}
      - follow: {speed: 0.1, force: 1, seconds: 110, pattern: circle}
)";

TEST_F(FlightTest, TheReplayOfARecordingGivesTheSameForcesToTheBit) {
  Observer observer{address("observer")};
  Process museum{host("museum", models().organ)};
  Process desk{hrtc("desk", {"--flight-recorder", "1", "--flight-file", path("end.mcap"), "--pool", "4000"})};
  EXPECT_TRUE(desk.wait_for_line("flight recorder: the last 1 s, .* MiB at most"));
  Process users{sim(kTwoUsersFollow)};
  // Long enough that the recorder, which keeps 1 s, has dropped the first cycles.
  ASSERT_TRUE(observer.until([](const Seen& seen) {
    return seen.user("ann").exact > 600 && seen.user("bob").exact > 300;
  })) << "exact states of ann: "
      << observer.seen().user("ann").exact << " of " << observer.seen().user("ann").count
      << ", of bob: " << observer.seen().user("bob").exact << " of " << observer.seen().user("bob").count << "\n"
      << users.output() << desk.output();
  Process stop{in_session("control", {"stop"})};
  EXPECT_TRUE(desk.wait_for_line("flight recording .*-1.mcap: [0-9]+ cycles"));
  EXPECT_TRUE(exits_with(0, stop));
  desk.signal(SIGUSR1);
  EXPECT_TRUE(desk.wait_for_line("flight recording .*-2.mcap: [0-9]+ cycles"));
  users.signal(SIGINT);
  EXPECT_TRUE(exits_with(1, users));
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_THAT(desk.output(), HasSubstr("flight recording " + path("end.mcap")));

  const std::vector<std::string> files = recordings();
  ASSERT_EQ(files.size(), 2u);
  const std::string of_stop = replay_output(files[0], 0, models().organ);
  EXPECT_THAT(of_stop, HasSubstr("written for: emergency stop"));
  EXPECT_THAT(of_stop, HasSubstr(" 1 stops, 0 resets"));
  EXPECT_THAT(of_stop, HasSubstr("from cycle "));
  EXPECT_THAT(of_stop, HasSubstr("every force is the same to the bit"));
  EXPECT_THAT(replay_output(files[1], 0, models().organ), HasSubstr("written for: requested by a signal"));
  EXPECT_THAT(replay_output(path("end.mcap"), 0, models().organ), HasSubstr("written for: the end"));
  Process to_csv{program("replay", {path("end.mcap"), "--model", models().organ, "--to-csv", path("forces.csv")})};
  EXPECT_TRUE(exits_with(0, to_csv));
  EXPECT_THAT(test_support::read_bytes(path("forces.csv")), testing::StartsWith("cycle,time_ns,probe,x,y,z,status,"));
  EXPECT_EQ(std::filesystem::status(path("forces.csv")).permissions(), std::filesystem::perms{0600});
  EXPECT_THAT(replay_output(path("end.mcap"), 2, models().sphere),
              HasSubstr("object 'organ' is of the model with digest "));
}

TEST_F(FlightTest, AReplayThatFailsLeavesNoTable) {
  Process without_folder{program("replay", {path("none.mcap"), "--to-csv", path("none/forces.csv")})};
  EXPECT_TRUE(exits_with(2, without_folder));
  EXPECT_THAT(without_folder.output(), HasSubstr("none/forces.csv: No such file or directory"));

  Process without_recording{program("replay", {path("none.mcap"), "--to-csv", path("forces.csv")})};
  EXPECT_TRUE(exits_with(2, without_recording));
  EXPECT_THAT(without_recording.output(), HasSubstr("none.mcap: No such file or directory"));
  for (const char* name : {"forces.csv", "forces.csv.part"}) EXPECT_FALSE(std::filesystem::exists(path(name))) << name;
}

TEST_F(FlightTest, AFileThatCannotBeWrittenIsReportedAtStartup) {
  Process desk{hrtc("desk", {"--flight-file", path("none/x.mcap")})};
  EXPECT_TRUE(exits_with(2, desk));
  EXPECT_THAT(desk.output(), HasSubstr("cannot write the flight recording " + path("none/x.mcap")));
}

}  // namespace
}  // namespace tactus::e2e
