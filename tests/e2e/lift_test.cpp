/// Users lift, grab and put down a crate: together at two HRTCs, alone, and with an HRTC that is killed.
#include <nlohmann/json.hpp>

#include "session/figures.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

namespace figures = session::figures;
using Seen = Observer::Seen;

/// Checks the lower bound of the energy at the port of a hand: -1 uJ if no cycle was skipped. During a skipped cycle
/// the previous force still acts. Its energy is at most the device's maximum force times the maximum travel in a cycle.
void expect_passive_ports(const nlohmann::json& published) {
  constexpr double kPerSkippedCycle = 8 * 0.4 * 1e-3 * 1e6;  // uJ; 8 N at 0.4 m/s for 1 ms
  const double skipped = published[figures::kSkipped].get<double>();
  EXPECT_GE(published[figures::kPortLowest].get<double>(), -1 - skipped * kPerSkippedCycle)
      << skipped << " cycles were skipped";
}

// After the lift the hands leave the crate, and it needs a moment to fall from an edge onto its face. The wait keeps the
// session open until then.
constexpr char kLift[] = R"(name: lift
duration: 11
users:
  - name: dan
    hrtc: desk1
    script:
      - lift: {object: crate, direction: [1, 0, 0], height: 0.05, seconds: 4, speed: 0.15}
      - wait: {seconds: 0.5}
  - name: eve
    hrtc: desk2
    script:
      - lift: {object: crate, direction: [-1, 0, 0], height: 0.05, seconds: 4, speed: 0.15}
      - wait: {seconds: 0.5}
)";

class LiftTest : public SessionTest {
 protected:
  /// A host of a crate of 12 cm on the ground, and of `other_objects`, in YAML.
  [[nodiscard]] std::vector<std::string> crate_host(const std::string& mass_kg = "0.8",
                                                    const std::string& other_objects = "") const {
    const std::string crate = path("crate.spm");
    EXPECT_EQ(Process{program("mesh", {"generate", "box", "--faces", "1200", path("crate.ply")})}.wait(), 0);
    EXPECT_EQ(Process{program("mesh", {"build", path("crate.ply"), crate, "--size", "0.12"})}.wait(), 0);
    write("store.yaml",
          "objects:\n  - model: crate.spm\n    position: [0, 0, 0.06]\n"
          "    material: {stiffness: 1000, static_friction: 0.9, dynamic_friction: 0.8}\n"
          "    body: {mass: " +
              mass_kg + ", friction: 0.6}\n" + other_objects);
    return in_session("host", {"--name", "store", "--config", path("store.yaml")});
  }
  /// Simulated users that follow `scenario` and write a report.
  [[nodiscard]] std::vector<std::string> reporting_sim(const std::string& scenario) const {
    return sim(scenario, {"--json", path("report.json")});
  }
  [[nodiscard]] nlohmann::json report() const {
    return nlohmann::json::parse(test_support::read_bytes(path("report.json")));
  }
};

TEST_F(LiftTest, TwoUsersAtTwoHrtcsLiftHoldAndPutDownACrateTooHeavyForOne) {
  // The crate weighs 6.1 N. A user presses with 6 N, and the device's limit of 8 N leaves 5.3 N to raise it. A heavier
  // crate would reach that limit on a loaded machine and rise less far.
  Process store{crate_host("0.62")};
  Process desk1{coding_hrtc("desk1")};
  Process desk2{coding_hrtc("desk2")};
  Process users{reporting_sim(kLift)};
  ASSERT_TRUE(exits_with(0, users)) << users.output();
  EXPECT_TRUE(exits_with(0, desk1));
  EXPECT_TRUE(exits_with(0, desk2));
  EXPECT_TRUE(exits_with(0, store));

  const nlohmann::json all = report();
  for (const auto& user : all["users"]) EXPECT_EQ(user["lifts"], 1) << all.dump(1);
  ASSERT_EQ(all["objects"].size(), 1u);
  const auto& crate = all["objects"][0];
  // A simulated arm needs about 1 s to carry the full weight, and the users do not lift at the same time. So they hold
  // the crate for 4 s.
  EXPECT_NEAR(crate["max_raised_m"].get<double>(), 0.05, 0.015);
  EXPECT_NEAR(crate["last_raised_m"].get<double>(), 0, 0.003);
  EXPECT_GE(crate["takeovers"].get<int>(), 1);
  EXPECT_LT(all["injected_j"].get<double>(), 1e-3);
  for (const auto& participant : all["participants"]) {
    if (participant["role"] != "hrtc") continue;
    const auto& published = participant["figures"];
    EXPECT_GE(published[figures::kCopyGroups].get<double>(), 1);
    EXPECT_GT(published[figures::kCopiesApart].get<double>(), 0);
    // 4 to 6 mm on a machine without other load. The distance grows with the delay of the samples.
    EXPECT_LT(published[figures::kCopiesApart].get<double>(), 25'000);
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

TEST_F(LiftTest, AUserGrabsACrateAndPutsItOnATableThatIsFixed) {
  Process store{crate_host("0.4", "  - {name: table, model: crate.spm, position: [0.3, 0, 0.06]}\n")};
  Process desk{coding_hrtc("desk")};
  Process users{reporting_sim(kGrab)};
  ASSERT_TRUE(exits_with(0, users)) << users.output();
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_TRUE(exits_with(0, store));
  EXPECT_THAT(desk.output(), testing::HasSubstr("user dan cannot hold 'table'"));
  EXPECT_THAT(desk.output(), testing::HasSubstr("user dan holds 'crate'"));

  const nlohmann::json all = report();
  const auto& dan = all["users"][0];
  EXPECT_EQ(dan["grabs"], 1) << all.dump(1);
  EXPECT_EQ(dan["grabs_refused"], 1);
  EXPECT_EQ(dan["grabs_lost"], 0);
  EXPECT_LT(dan["force_max_n"].get<double>(), 8.001);
  const auto& crate = all["objects"][0];
  EXPECT_NEAR(crate["max_raised_m"].get<double>(), 0.15, 0.02);
  EXPECT_NEAR(crate["last_raised_m"].get<double>(), 0.12, 0.003)
      << "on top of the table, although the hand pressed the crate down";
  for (const auto& participant : all["participants"]) {
    if (participant["role"] != "hrtc") continue;
    EXPECT_EQ(participant["figures"][figures::kGrabs], 1);
    expect_passive_ports(participant["figures"]);
  }
}

constexpr char kLongHold[] = R"(name: hold
duration: 4
users:
  - name: dan
    script: [{grab: {object: crate, direction: [0, 0, 1]}}, {move: {by: [0, 0, 0.05], speed: 0.1, seconds: 60}}]
)";

TEST_F(LiftTest, AHostPutsDownTheObjectThatAKilledHrtcHeld) {
  Process store{crate_host()};
  Process desk{coding_hrtc("desk")};
  Observer observer{address("observer")};
  Process users{reporting_sim(kLongHold)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.figure("desk", figures::kGrabs) == 1; }));
  const std::uint64_t published = observer.seen().metrics_count("desk");
  ASSERT_TRUE(observer.until([&](const Seen& seen) { return seen.metrics_count("desk") > published; }))
      << "metrics that follow half a second later";
  desk.signal_all(SIGKILL);
  (void)users.wait();
  EXPECT_TRUE(exits_with(0, store));
  const nlohmann::json all = report();
  ASSERT_EQ(all["objects"].size(), 1u) << all.dump(1);
  const auto& crate = all["objects"][0];
  EXPECT_GT(crate["max_raised_m"].get<double>(), 0.005);
  EXPECT_NEAR(crate["last_raised_m"].get<double>(), 0, 0.003);
  EXPECT_GE(crate["takeovers"].get<int>(), 2) << "first by the HRTC, then by the host";
}

}  // namespace
}  // namespace tactus::e2e
