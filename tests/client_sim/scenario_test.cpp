#include "client_sim/scenario.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <string>

#include "tests/support/temporary_folder.hpp"
#include "yaml/reader.hpp"

namespace tactus::client_sim {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

std::string error_of(const std::string& text) {
  try {
    (void)parse_scenario(text, "s.yaml");
  } catch (const yaml::YamlError& error) {
    return error.what();
  }
  return "";
}

/// Returns a scenario with one action, which begins at line 5, column 9.
std::string with_action(const std::string& action) {
  return "name: t\nusers:\n  - name: ann\n    script:\n      - " + action + "\n";
}

TEST(Scenario, HasTheValuesOfItsText) {
  const Scenario scenario = parse_scenario(R"(
name: two
duration: 12.5
seed: 77
users:
  - name: ann
    hrtc: left
    radius: 0.004
    repeat: true
    remote: true
    script:
      - approach: {object: organ, direction: [0, 0, 2], point: [0.25, 0.5, 1], speed: 0.2, until_force: 0.75}
      - tap: {count: 3, speed: 0.5, force: 2, depth: 0.004}
      - follow: {speed: 0.05, force: 1.5, seconds: 8, pattern: zigzag, extent: 0.02}
      - hold: {seconds: 2, force: 1}
      - wait: {seconds: 0.5}
      - retreat:
  - name: bob
    script:
      - approach: {object: "#2"}
)",
                                           "s.yaml");
  EXPECT_EQ(scenario.name, "two");
  EXPECT_EQ(scenario.duration, 12.5);
  EXPECT_EQ(scenario.seed, 77u);
  ASSERT_EQ(scenario.users.size(), 2u);
  const User& ann = scenario.users[0];
  EXPECT_EQ(ann.hrtc, "left");
  EXPECT_EQ(ann.radius, 0.004);
  EXPECT_TRUE(ann.repeats_script);
  EXPECT_TRUE(ann.has_remote_device);
  ASSERT_EQ(ann.script.size(), 6u);
  EXPECT_EQ(ann.script[0].kind, ActionKind::kApproach);
  EXPECT_EQ(ann.script[0].object, "organ");
  EXPECT_EQ(ann.script[0].direction, Vec3d(0, 0, 1));
  EXPECT_EQ(ann.script[0].point, Vec3d(0.25, 0.5, 1));
  EXPECT_EQ(ann.script[0].force, 0.75);
  EXPECT_EQ(ann.script[1].kind, ActionKind::kTap);
  EXPECT_EQ(ann.script[1].count, 3u);
  EXPECT_EQ(ann.script[1].depth, 0.004);
  EXPECT_EQ(ann.script[2].pattern, Pattern::kZigzag);
  EXPECT_EQ(ann.script[2].extent, 0.02);
  EXPECT_EQ(ann.script[3].kind, ActionKind::kHold);
  EXPECT_EQ(ann.script[4].seconds, 0.5);
  EXPECT_EQ(ann.script[5].kind, ActionKind::kRetreat);
  EXPECT_EQ(scenario.users[1].hrtc, "#1");
  EXPECT_FALSE(scenario.users[1].repeats_script);
  EXPECT_FALSE(scenario.users[1].has_remote_device);
}

TEST(Scenario, BuiltInScenariosAreValid) {
  for (const BuiltInScenario& built_in : built_in_scenarios()) {
    const Scenario scenario = load_scenario(built_in.name);
    EXPECT_EQ(scenario.name, built_in.name);
  }
  EXPECT_EQ(load_scenario("demo").users.size(), 3u);
  EXPECT_EQ(load_scenario("demo-lift").users.size(), 5u);
}

TEST(Scenario, ReadsToolsAndTilts) {
  const Scenario scenario = load_scenario("tool-scan");
  EXPECT_EQ(scenario.tool, Tool::kStylus);
  EXPECT_EQ(scenario.users[0].script[1].tilt, 1.6);
  EXPECT_EQ(load_scenario("follow-scan").tool, Tool::kSphere);
  EXPECT_EQ(load_scenario("follow-scan").users[0].script[1].tilt, 0);
}

TEST(Scenario, ReadsALift) {
  const Scenario scenario = load_scenario("lift");
  ASSERT_EQ(scenario.users.size(), 2u);
  const Action& lift = scenario.users[1].script.at(0);
  EXPECT_EQ(lift.kind, ActionKind::kLift);
  EXPECT_EQ(lift.object, "crate");
  EXPECT_EQ(lift.direction, -Vec3d::UnitX());
  EXPECT_EQ(lift.force, 6);
  EXPECT_EQ(lift.height, 0.1);
  EXPECT_EQ(lift.seconds, 2);
  EXPECT_EQ(lift.min_other_users, 1u);
}

TEST(Scenario, ReadsAGrabAndTheActionsAfterIt) {
  const auto script = [](const std::string& actions) {
    return parse_scenario("name: x\nusers:\n  - name: ann\n    script:\n" + actions, "test").users[0].script;
  };
  const std::vector<Action> read = script(
      "      - grab: {object: crate, until_force: 0.4}\n      - move: {by: [0, 0, 0.1], speed: 0.2}\n"
      "      - wait: {}\n      - release: {}\n      - retreat: {}\n");
  EXPECT_EQ(read[0].kind, ActionKind::kGrab);
  EXPECT_EQ(read[0].force, 0.4);
  EXPECT_EQ(read[1].kind, ActionKind::kMove);
  EXPECT_EQ(read[1].displacement, Vec3d(0, 0, 0.1));
  EXPECT_EQ(read[1].speed, 0.2);
  EXPECT_EQ(read[3].kind, ActionKind::kRelease);
  EXPECT_THROW(script("      - approach: {object: crate}\n      - release: {}\n"), yaml::YamlError);
  EXPECT_THROW(script("      - grab: {object: crate}\n      - tap: {}\n"), yaml::YamlError);
  EXPECT_THROW(script("      - grab: {object: crate}\n      - move: {speed: 1}\n"), yaml::YamlError);
}

TEST(Scenario, RefusesToRepeatAScriptThatEndsWithAHeldObject) {
  const auto repeating = [](const std::string& script) {
    return "name: t\nusers:\n  - name: ann\n    repeat: true\n    script: [" + script + "]\n";
  };
  const std::string grab_and_move = "{grab: {object: crate}}, {move: {by: [0, 0, 0.1]}}";
  EXPECT_EQ(error_of(repeating(grab_and_move)),
            "s.yaml:5:13: users[0].script: the hand holds something at the end: expected release, because the script "
            "repeats");
  EXPECT_EQ(error_of(repeating(grab_and_move + ", {release: {}}")), "");
}

TEST(Scenario, ReadsMeasureAndGroundTruth) {
  const std::string users = "users: [{name: ann, script: [wait: {}]}]\n";
  const Scenario scenario = parse_scenario("name: t\nmeasures: forces\ntruth: analytic\n" + users, "s.yaml");
  EXPECT_EQ(scenario.measures, Measure::kForces);
  EXPECT_EQ(scenario.truth, Truth::kAnalytic);
  EXPECT_THAT(error_of("name: t\nmeasures: forces\n" + users), HasSubstr("key 'truth' is missing"));
  EXPECT_THAT(error_of("name: t\ntruth: full-mesh\n" + users), HasSubstr("s.yaml:2:8: truth: found 'full-mesh'"));
  EXPECT_THAT(error_of("name: t\nmeasures: joy\ntruth: analytic\n" + users),
              HasSubstr("measures: found 'joy', expected one of nothing, forces, first-touch, target"));
}

TEST(Scenario, VariesItsPointsWithTheSeedWithinTheSpread) {
  const Scenario scenario = load_scenario("tap-scan");
  const Scenario first = varied(scenario, 1), repeated = varied(scenario, 1), second = varied(scenario, 2);
  for (std::size_t i = 0; i < scenario.users[0].script.size(); ++i) {
    const Vec3d& point = first.users[0].script[i].point;
    EXPECT_EQ(point, repeated.users[0].script[i].point);
    EXPECT_NE(point, second.users[0].script[i].point);
    EXPECT_LE((point - scenario.users[0].script[i].point).cwiseAbs().maxCoeff(), scenario.target_spread);
  }
}

TEST(Scenario, ErrorsNameThePositionTheKeyTheValueFoundAndTheValueExpected) {
  EXPECT_EQ(error_of(with_action("tap: {object: a, speed: 9}")),
            "s.yaml:5:33: users[0].script[0].tap.speed: found '9', expected a number from 0.0001 to 0.5");
  EXPECT_EQ(error_of(with_action("tap: {object: a, sped: 9}")),
            "s.yaml:5:26: users[0].script[0].tap: unknown key 'sped', expected one of object, direction, point, count, "
            "speed, force, depth");
  EXPECT_EQ(
      error_of(with_action("poke: {}")),
      "s.yaml:5:9: users[0].script[0]: unknown key 'poke', expected one of approach, tap, follow, lift, grab, move, "
      "release, hold, wait, retreat");
  EXPECT_EQ(error_of("name: t\nuser: 3\n"),
            "s.yaml:2:1: unknown key 'user', expected one of name, measures, truth, within, tool, duration, "
            "seed, spread, users");
}

TEST(Scenario, RefusesInvalidValues) {
  EXPECT_THAT(error_of(with_action("tap: {object: a, count: 2.5}")), HasSubstr("expected a whole number"));
  EXPECT_THAT(error_of(with_action("tap: {object: a, count: many}")),
              HasSubstr("count: found 'many', expected a number"));
  EXPECT_THAT(error_of(with_action("tap: {object: a, speed: .nan}")), HasSubstr("speed: found '.nan'"));
  EXPECT_THAT(error_of(with_action("tap: {object: a, speed: -.inf}")), HasSubstr("speed: found '-.inf'"));
  EXPECT_THAT(error_of(with_action("tap: {object: a, direction: [0, 0, 0]}")), HasSubstr("found a zero vector"));
  EXPECT_THAT(error_of(with_action("tap: {object: a, direction: [0, 1]}")), HasSubstr("expected a list of 3 numbers"));
  EXPECT_THAT(error_of(with_action("tap: {object: a, point: [0, 0, 2]}")), HasSubstr("tap.point[2]: found '2'"));
  EXPECT_THAT(error_of(with_action("tap: {object: [a]}")), HasSubstr("object: found a list, expected a text"));
  EXPECT_THAT(error_of(with_action("tap: {object: " + std::string(64, 'x') + "}")), HasSubstr("1 to 63 bytes"));
  EXPECT_THAT(error_of(with_action("follow: {object: a, pattern: spiral}")),
              HasSubstr("one of circle, zigzag, around"));
  EXPECT_THAT(error_of(with_action("tap: 3")), HasSubstr("tap: found '3', expected a map"));
  EXPECT_THAT(error_of(with_action("tap")), HasSubstr("found 'tap', expected a map"));
  EXPECT_THAT(error_of(with_action("{tap: {object: a}, wait: {}}")), HasSubstr("expected a map with one action"));
}

TEST(Scenario, RefusesMissingAndRepeatedKeys) {
  EXPECT_THAT(error_of(""), HasSubstr("key 'name' is missing"));
  EXPECT_THAT(error_of("name: t\n"), HasSubstr("key 'users' is missing"));
  EXPECT_THAT(error_of("users: []\nname: t\n"), HasSubstr("users: found an empty list, expected a list of users"));
  EXPECT_THAT(error_of("name: t\nusers:\n  - script: []\n"), HasSubstr("users[0]: key 'name' is missing"));
  EXPECT_THAT(error_of("name: t\nname: u\nusers: []\n"), HasSubstr("key 'name' occurs twice"));
  EXPECT_THAT(error_of(with_action("retreat: {}")), HasSubstr("key 'object' is missing"));
  EXPECT_THAT(error_of(with_action("tap: {}")),
              HasSubstr("users[0].script[0]: key 'object' is missing, and no earlier action has one"));
  EXPECT_THAT(error_of("name: t\nusers:\n  - {name: a, script: [wait: {}]}\n  - {name: a, script: [wait: {}]}\n"),
              HasSubstr("name 'a' occurs twice"));
}

TEST(Scenario, NamesThePositionOfASyntaxError) {
  EXPECT_THAT(error_of("name: t\nusers: [\n"), StartsWith("s.yaml:3:1: not YAML:"));
}

TEST(Scenario, AnUnknownNameListsTheBuiltInScenarios) {
  try {
    (void)load_scenario("/nowhere/x.yaml");
    FAIL();
  } catch (const ScenarioError& error) {
    EXPECT_THAT(error.what(), HasSubstr("(touch, follow, lift, grab, demo, demo-lift, tap-wall, "));
  }
}

TEST(Scenario, IsReadFromAFile) {
  const std::string path = ::testing::TempDir() + "tactus_scenario_test.yaml";
  std::ofstream{path} << with_action("wait: {seconds: 3}");
  EXPECT_EQ(load_scenario(path).users[0].script[0].seconds, 3);
  std::remove(path.c_str());
}

TEST(Scenario, AnEmptyFileLacksItsKeys) {
  const test_support::TemporaryFolder folder;
  const std::string path = (folder.path() / "empty.yaml").string();
  test_support::write_bytes(path, "");
  try {
    (void)load_scenario(path);
    FAIL() << "expected an error";
  } catch (const std::exception& error) {
    EXPECT_EQ(error.what(), path + ":1:1: key 'name' is missing");
  }
}

TEST(OrdinalOf, ReadsTheNumberAfterAHash) {
  EXPECT_EQ(ordinal_of("#1"), 1u);
  EXPECT_EQ(ordinal_of("#12"), 12u);
  EXPECT_EQ(ordinal_of("organ"), 0u);
  EXPECT_EQ(ordinal_of("#x"), 0u);
  EXPECT_EQ(ordinal_of("#"), 0u);
}

}  // namespace
}  // namespace tactus::client_sim
