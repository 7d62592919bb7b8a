#include "study/scenario_run.hpp"

#include <gtest/gtest.h>

namespace tactus::study {
namespace {

const std::atomic<bool> kNoStop{false};

double value_of(const ScenarioRun& run, const std::string& name) {
  for (const Figure& figure : run.figures)
    if (figure.name == name) return figure.value;
  ADD_FAILURE() << name;
  return -1;
}

client_sim::Scenario short_one(const std::string& script, const std::string& head) {
  return client_sim::parse_scenario(
      "name: t\nspread: 0.1\nduration: 8\n" + head + "users:\n  - name: ann\n    script:\n" + script, "t.yaml");
}

class OnAScan : public ::testing::Test {
 protected:
  static ScenarioRun run(const client_sim::Scenario& scenario, const std::string& link, std::uint64_t seed = 1) {
    static const Subject scan = make_subject("scan", "organ", 40'000, 0.1);
    return run_scenario(scenario, scan, netem::parse_link(link), seed, kNoStop);
  }
};

TEST_F(OnAScan, WithoutDelayForcesAreThoseOfTheFullMeshToTheBit) {
  const ScenarioRun run = OnAScan::run(client_sim::load_scenario("tap-scan"), "P0");
  EXPECT_EQ(value_of(run, "touches"), 6);
  EXPECT_EQ(value_of(run, "exact"), 100);
  EXPECT_EQ(value_of(run, "force error max"), 0);
  EXPECT_GT(value_of(run, "contact"), 0.2);
}

TEST_F(OnAScan, AToolFeelsForceAndTorqueOfTheFullMeshToTheBitWithoutDelay) {
  const client_sim::Scenario scenario = client_sim::load_scenario("tool-scan");
  const ScenarioRun near = OnAScan::run(scenario, "P0"), far = OnAScan::run(scenario, "P0:delay=300");
  EXPECT_EQ(value_of(near, "exact"), 100);
  EXPECT_EQ(value_of(near, "force error max"), 0);
  EXPECT_EQ(value_of(near, "torque error max"), 0);
  EXPECT_GT(value_of(near, "contact"), 6);
  EXPECT_GT(value_of(near, "true torque rms"), 2);
  // The compared figures do depend on the mesh.
  EXPECT_LT(value_of(far, "exact"), 98);
  EXPECT_GT(value_of(far, "force error max"), 0.1);
  EXPECT_GT(value_of(far, "torque error max"), 0.5);
}

TEST_F(OnAScan, ARemoteTiltedHandReceivesTheForceOfItsToolLate) {
  client_sim::Scenario scenario = short_one(
      "      - approach: {object: scan}\n      - follow: {seconds: 2, pattern: circle, extent: 0.01, lean: 1.6}\n",
      "measures: forces\ntruth: full-mesh\ntool: stylus\n");
  scenario.users[0].has_remote_device = true;
  const ScenarioRun there = run(scenario, "P0:delay=20");
  EXPECT_GT(value_of(there, "contact"), 1);
  EXPECT_GT(value_of(there, "torque error max"), 0.1);
  double turned = 0;
  for (const Sample& sample : there.hands[0]) turned = std::max(turned, sample.felt.torque.norm());
  EXPECT_GT(turned, 1e-5);
}

TEST_F(OnAScan, TheSameSeedGivesTheSameRunAndAnotherAnother) {
  const client_sim::Scenario scenario =
      short_one("      - tap: {object: scan, count: 1, speed: 0.5}\n", "measures: forces\ntruth: full-mesh\n");
  const ScenarioRun first = run(scenario, "P7", 5), again = run(scenario, "P7", 5), other = run(scenario, "P7", 6);
  ASSERT_EQ(first.figures.size(), again.figures.size());
  for (std::size_t i = 0; i < first.figures.size(); ++i) EXPECT_EQ(first.figures[i].value, again.figures[i].value);
  ASSERT_EQ(first.hands[0].size(), again.hands[0].size());
  EXPECT_NE(first.hands[0].back().position, other.hands[0].back().position);
}

TEST_F(OnAScan, AColdStartTakesAsLongAsTheLink) {
  const client_sim::Scenario scenario = client_sim::load_scenario("cold-start");
  const ScenarioRun near = run(scenario, "P0"), far = run(scenario, "P0:delay=40");
  // The catalogue takes one way, then two demands and their answers take two round trips.
  EXPECT_LT(value_of(near, "time to base mesh"), 20);
  EXPECT_GT(value_of(far, "time to base mesh"), 3 * 40);
  EXPECT_LT(value_of(far, "time to base mesh"), 400);
  EXPECT_GT(value_of(near, "received until exact"), 1);
}

TEST(OnAWall, ARemoteHandFeelsTheWallLateAndALocalOneAtOnce) {
  const Subject wall = make_subject("wall", "wall", 2000, 0.2);
  const std::string tap = "      - tap: {object: wall, count: 2, speed: 0.2}\n";
  const std::string head = "measures: forces\ntruth: analytic\n";
  client_sim::Scenario scenario = short_one(tap, head);
  const netem::LinkSettings link = netem::parse_link("P0:delay=20");
  const ScenarioRun here = run_scenario(scenario, wall, link, 1, kNoStop);
  scenario.users[0].has_remote_device = true;
  const ScenarioRun there = run_scenario(scenario, wall, link, 1, kNoStop);
  EXPECT_EQ(value_of(here, "touches"), 2);
  EXPECT_EQ(value_of(here, "onset error"), 0);
  EXPECT_LT(value_of(here, "force error max"), 1e-6);
  EXPECT_NEAR(value_of(there, "onset error"), 40, 5);  // a round trip
  EXPECT_GT(value_of(there, "above 1 JND"), 90);
}

TEST(ObjectOf, IsTheOneThatUsersTouch) {
  EXPECT_EQ(object_of(client_sim::load_scenario("tap-wall")), "wall");
  EXPECT_THROW((void)object_of(client_sim::load_scenario("demo")), client_sim::ScenarioError);
}

TEST(Run, EndsOnceItIsStopped) {
  const Subject wall = make_subject("wall", "wall", 2000, 0.2);
  const std::atomic<bool> stop{true};
  EXPECT_TRUE(
      run_scenario(client_sim::load_scenario("tap-wall"), wall, netem::parse_link("P0"), 1, stop).figures.empty());
}

}  // namespace
}  // namespace tactus::study
