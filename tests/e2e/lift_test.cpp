/// Two users at two HRTCs lift a crate that neither could lift alone.
#include <nlohmann/json.hpp>

#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;

/// Checks the lower bound of the energy of a hand's port: -1 uJ if each cycle ran. In a skipped cycle the force of the
/// cycle before acts on, so each may give a hand the largest force of the device times the largest travel in a cycle.
void expect_passive_ports(const nlohmann::json& figures) {
  constexpr double kPerSkippedCycle = 8 * 0.4 * 1e-3 * 1e6;  // uJ; 8 N at 0.4 m/s for 1 ms
  const double skipped = figures[session::figures::kSkipped].get<double>();
  EXPECT_GE(figures[session::figures::kPortLowest].get<double>(), -1 - skipped * kPerSkippedCycle)
      << skipped << " cycles were skipped";
}

constexpr char kLift[] = R"(name: lift
duration: 11
users:
  - name: dan
    hrtc: desk1
    script: [{lift: {object: crate, direction: [1, 0, 0], height: 0.05, seconds: 4, speed: 0.15}}]
  - name: eve
    hrtc: desk2
    script: [{lift: {object: crate, direction: [-1, 0, 0], height: 0.05, seconds: 4, speed: 0.15}}]
)";

class LiftTest : public SessionTest {
 protected:
  /// A host of one crate of 0.8 kg and 12 cm that stands on the ground.
  [[nodiscard]] std::vector<std::string> crate_host() const {
    const std::string crate = path("crate.spm");
    EXPECT_EQ(Process{program("mesh", {"generate", "box", "--faces", "1200", path("crate.ply")})}.wait(), 0);
    EXPECT_EQ(Process{program("mesh", {"build", path("crate.ply"), crate, "--size", "0.12"})}.wait(), 0);
    write("store.yaml",
          "objects:\n  - model: crate.spm\n    position: [0, 0, 0.06]\n"
          "    material: {stiffness: 1000, static_friction: 0.9, dynamic_friction: 0.8}\n"
          "    body: {mass: 0.8, friction: 0.6}\n");
    return in_session("host", {"--name", "store", "--config", path("store.yaml")});
  }
};

TEST_F(LiftTest, TwoAtTwoHrtcsRaiseACrateHoldItAndPutItDown) {
  Process store{crate_host()};
  Process desk1{in_session("hrtc", {"--name", "desk1"})};
  Process desk2{in_session("hrtc", {"--name", "desk2"})};
  const std::string report = path("report.json");
  Process users{in_session("sim", {"--scenario", write("lift.yaml", kLift), "--json", report})};
  ASSERT_TRUE(ends_with(0, users)) << users.output();
  EXPECT_TRUE(ends_with(0, desk1));
  EXPECT_TRUE(ends_with(0, desk2));
  EXPECT_TRUE(ends_with(0, store));

  std::ifstream file{report};
  const nlohmann::json all = nlohmann::json::parse(file);
  for (const auto& user : all["users"]) EXPECT_EQ(user["lifts"], 1) << all.dump(1);
  ASSERT_EQ(all["objects"].size(), 1u);
  const auto& crate = all["objects"][0];
  // An arm takes a second to bear what it lifts, and the two need not be in step: they hold it for four.
  EXPECT_NEAR(crate["max_raised_m"].get<double>(), 0.05, 0.015);
  EXPECT_NEAR(crate["last_raised_m"].get<double>(), 0, 0.003);
  EXPECT_GE(crate["takeovers"].get<int>(), 1);
  EXPECT_LT(all["injected_j"].get<double>(), 1e-3);
  for (const auto& participant : all["participants"]) {
    if (participant["role"] != "hrtc") continue;
    const auto& published = participant["figures"];
    EXPECT_GE(published[figures::kCopyGroups].get<double>(), 1);
    EXPECT_GT(published[figures::kCopiesApart].get<double>(), 0);
    EXPECT_LT(published[figures::kCopiesApart].get<double>(), 15'000);
    expect_passive_ports(published);
  }
}

constexpr char kGrab[] = R"(name: grab
duration: 9
users:
  - name: dan
    script:
      - grab: {object: "#1", direction: [0, 0, 1]}
      - release: {}
      - grab: {object: crate, direction: [0, 0, 1]}
      - move: {by: [0, 0, 0.15], speed: 0.3, seconds: 0.1}
      - move: {by: [0.3, 0, 0], speed: 0.4, seconds: 0.3}
      - move: {by: [0, 0, -0.04], speed: 0.1, seconds: 0.1}
      - release: {}
      - wait: {seconds: 0.3}
)";

TEST_F(LiftTest, OneGrabsACrateAndPutsItOnATableThatItCannotHave) {
  std::vector<std::string> host = crate_host();
  write("store.yaml",
        "objects:\n  - model: crate.spm\n    position: [0, 0, 0.06]\n"
        "    material: {stiffness: 1000, static_friction: 0.9, dynamic_friction: 0.8}\n"
        "    body: {mass: 0.4, friction: 0.6}\n"
        "  - {name: table, model: crate.spm, position: [0.3, 0, 0.06]}\n");
  Process store{host};
  Process desk{in_session("hrtc", {"--name", "desk"})};
  const std::string report = path("report.json");
  Process users{in_session("sim", {"--scenario", write("grab.yaml", kGrab), "--json", report})};
  ASSERT_TRUE(ends_with(0, users)) << users.output();
  EXPECT_TRUE(ends_with(0, desk));
  EXPECT_TRUE(ends_with(0, store));
  EXPECT_THAT(desk.output(), testing::HasSubstr("user dan cannot hold 'table'"));
  EXPECT_THAT(desk.output(), testing::HasSubstr("user dan holds 'crate'"));

  std::ifstream file{report};
  const nlohmann::json all = nlohmann::json::parse(file);
  const auto& dan = all["users"][0];
  EXPECT_EQ(dan["grabs"], 1) << all.dump(1);
  EXPECT_EQ(dan["grabs_refused"], 1);
  EXPECT_EQ(dan["grabs_lost"], 0);
  EXPECT_LT(dan["force_max_n"].get<double>(), 8.001);
  const auto& crate = all["objects"][0];
  EXPECT_NEAR(crate["max_raised_m"].get<double>(), 0.15, 0.02);
  EXPECT_NEAR(crate["last_raised_m"].get<double>(), 0.12, 0.003) << "on the table, into which it was pressed";
  for (const auto& participant : all["participants"]) {
    if (participant["role"] != "hrtc") continue;
    EXPECT_EQ(participant["figures"][figures::kGrabs], 1);
    expect_passive_ports(participant["figures"]);
  }
}

constexpr char kHoldForLong[] = R"(name: hold
duration: 4
users:
  - name: dan
    script: [{grab: {object: crate, direction: [0, 0, 1]}}, {move: {by: [0, 0, 0.05], speed: 0.1, seconds: 60}}]
)";

TEST_F(LiftTest, WhatAKilledHrtcHeldIsPutDownByItsHost) {
  Process store{crate_host()};
  Process desk{in_session("hrtc", {"--name", "desk"})};
  Observer observer{address("observer")};
  const std::string report = path("report.json");
  Process users{in_session("sim", {"--scenario", write("hold.yaml", kHoldForLong), "--json", report})};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.figure("desk", figures::kGrabs) == 1; }));
  const std::uint64_t published = observer.seen().metrics_of("desk");
  ASSERT_TRUE(observer.until([&](const Seen& seen) { return seen.metrics_of("desk") > published; }))
      << "half a second later";
  desk.signal(SIGKILL);
  (void)users.wait();
  EXPECT_TRUE(ends_with(0, store));
  std::ifstream file{report};
  const nlohmann::json all = nlohmann::json::parse(file);
  ASSERT_EQ(all["objects"].size(), 1u) << all.dump(1);
  const auto& crate = all["objects"][0];
  EXPECT_GT(crate["max_raised_m"].get<double>(), 0.005);
  EXPECT_NEAR(crate["last_raised_m"].get<double>(), 0, 0.003);
  EXPECT_GE(crate["takeovers"].get<int>(), 2) << "by the desk, and by the host again";
}

}  // namespace
}  // namespace tactus::e2e
