#include "study/scenario_run.hpp"

#include <gtest/gtest.h>

#include "tests/study/figures.hpp"

namespace tactus::study {
namespace {

/// A scenario of 8 s with one user. `head`: further keys of the scenario.
client_sim::Scenario short_scenario(const std::string& script, const std::string& head) {
  return client_sim::parse_scenario(
      "name: t\nspread: 0.1\nduration: 8\n" + head + "users:\n  - name: ann\n    script:\n" + script, "t.yaml");
}

class ScenarioOnScan : public ::testing::Test {
 protected:
  static ScenarioRun run(const client_sim::Scenario& scenario, const std::string& link, std::uint64_t seed = 1) {
    static const Subject kScan = make_subject("scan", "organ", 40'000, 0.1);
    return run_scenario(scenario, kScan, netem::parse_link(link), seed, kNoStop);
  }
};

TEST_F(ScenarioOnScan, ATipFeelsTheForceOfTheFullMeshToTheBitWithoutDelay) {
  const ScenarioRun result = run(client_sim::load_scenario("tap-scan"), "P0");
  EXPECT_EQ(value_of(result.figures, "touches"), 6);
  EXPECT_EQ(value_of(result.figures, "exact"), 100);
  EXPECT_EQ(value_of(result.figures, "force error max"), 0);
  EXPECT_GT(value_of(result.figures, "contact"), 0.2);
}

TEST_F(ScenarioOnScan, AToolFeelsForceAndTorqueOfTheFullMeshToTheBitWithoutDelay) {
  const client_sim::Scenario scenario = client_sim::load_scenario("tool-scan");
  const ScenarioRun without_delay = run(scenario, "P0"), with_delay = run(scenario, "P0:delay=300");
  EXPECT_EQ(value_of(without_delay.figures, "exact"), 100);
  EXPECT_EQ(value_of(without_delay.figures, "force error max"), 0);
  EXPECT_EQ(value_of(without_delay.figures, "torque error max"), 0);
  EXPECT_GT(value_of(without_delay.figures, "contact"), 6);
  EXPECT_GT(value_of(without_delay.figures, "true torque rms"), 2);
  // With a delay, regions are missing at times, so the figures must differ from those above.
  EXPECT_LT(value_of(with_delay.figures, "exact"), 98);
  EXPECT_GT(value_of(with_delay.figures, "force error max"), 0.1);
  EXPECT_GT(value_of(with_delay.figures, "torque error max"), 0.5);
}

TEST_F(ScenarioOnScan, ARemoteTiltedHandFeelsTheTorqueOfItsToolLate) {
  client_sim::Scenario scenario = short_scenario(
      "      - approach: {object: scan}\n      - follow: {seconds: 2, pattern: circle, extent: 0.01, lean: 1.6}\n",
      "measures: forces\ntruth: full-mesh\ntool: stylus\n");
  scenario.users[0].has_remote_device = true;
  const ScenarioRun result = run(scenario, "P0:delay=20");
  EXPECT_GT(value_of(result.figures, "contact"), 1);
  EXPECT_GT(value_of(result.figures, "torque error max"), 0.1);
  double max_torque = 0;
  for (const Sample& sample : result.hands[0]) max_torque = std::max(max_torque, sample.felt.torque.norm());
  EXPECT_GT(max_torque, 1e-5);
}

TEST_F(ScenarioOnScan, TheSameSeedGivesTheSameRunAndAnotherSeedGivesAnotherRun) {
  const client_sim::Scenario scenario =
      short_scenario("      - tap: {object: scan, count: 1, speed: 0.5}\n", "measures: forces\ntruth: full-mesh\n");
  const ScenarioRun first = run(scenario, "P7", 5), repeated = run(scenario, "P7", 5), other = run(scenario, "P7", 6);
  ASSERT_EQ(first.figures.size(), repeated.figures.size());
  for (std::size_t i = 0; i < first.figures.size(); ++i) EXPECT_EQ(first.figures[i].value, repeated.figures[i].value);
  ASSERT_EQ(first.hands[0].size(), repeated.hands[0].size());
  EXPECT_NE(first.hands[0].back().position, other.hands[0].back().position);
}

TEST_F(ScenarioOnScan, AColdStartTakesTheRoundTripsOfTheLink) {
  const client_sim::Scenario scenario = client_sim::load_scenario("cold-start");
  const ScenarioRun without_delay = run(scenario, "P0"), with_delay = run(scenario, "P0:delay=40");
  // The catalogue takes half a round trip, and two demands with their answers take two round trips.
  EXPECT_LT(value_of(without_delay.figures, "time to base mesh"), 20);
  EXPECT_GT(value_of(with_delay.figures, "time to base mesh"), 3 * 40);
  EXPECT_LT(value_of(with_delay.figures, "time to base mesh"), 400);
  EXPECT_GT(value_of(without_delay.figures, "received until exact"), 1);
}

TEST_F(ScenarioOnScan, AColdStartWithoutExactContactCountsAllBytesReceived) {
  client_sim::Scenario scenario = client_sim::load_scenario("cold-start");
  scenario.duration = 0.1;  // ends before the hand reaches the surface
  const ScenarioRun result = run(scenario, "P0");
  ASSERT_EQ(value_of(result.figures, "time to exact contact"), 100);
  EXPECT_GT(value_of(result.figures, "received until exact"), 1);
}

TEST(ScenarioOnWall, ARemoteHandFeelsTheWallARoundTripLateAndALocalHandAtOnce) {
  const Subject wall = make_subject("wall", "wall", 2000, 0.2);
  const std::string tap = "      - tap: {object: wall, count: 2, speed: 0.2}\n";
  const std::string head = "measures: forces\ntruth: analytic\n";
  client_sim::Scenario scenario = short_scenario(tap, head);
  const netem::LinkSettings link = netem::parse_link("P0:delay=20");
  const ScenarioRun local = run_scenario(scenario, wall, link, 1, kNoStop);
  scenario.users[0].has_remote_device = true;
  const ScenarioRun remote = run_scenario(scenario, wall, link, 1, kNoStop);
  EXPECT_EQ(value_of(local.figures, "touches"), 2);
  EXPECT_EQ(value_of(local.figures, "onset time error"), 0);
  EXPECT_LT(value_of(local.figures, "force error max"), 1e-6);
  EXPECT_NEAR(value_of(remote.figures, "onset time error"), 40, 5);  // a round trip
  EXPECT_GT(value_of(remote.figures, "above 1 JND"), 90);
}

TEST(ObjectOf, IsTheObjectThatAllUsersTouch) {
  EXPECT_EQ(object_of(client_sim::load_scenario("tap-wall")), "wall");
  EXPECT_THROW((void)object_of(client_sim::load_scenario("demo")), client_sim::ScenarioError);
}

TEST(RunScenario, ReturnsNoFiguresWhenItIsStopped) {
  const Subject wall = make_subject("wall", "wall", 2000, 0.2);
  const std::atomic<bool> stop{true};
  EXPECT_TRUE(
      run_scenario(client_sim::load_scenario("tap-wall"), wall, netem::parse_link("P0"), 1, stop).figures.empty());
}

}  // namespace
}  // namespace tactus::study
