#include "study/study.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <fstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "netem/profile.hpp"
#include "study/runner.hpp"
#include "tests/support/temporary_folder.hpp"
#include "yaml/reader.hpp"

namespace tactus::study {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string error_of(const std::string& text) {
  try {
    (void)parse_study(text, "s.yaml");
  } catch (const yaml::YamlError& error) {
    return error.what();
  }
  return "";
}

TEST(Study, HasTheValuesOfItsText) {
  const Study study = parse_study(R"(
name: mine
profiles: [P4, "P0:delay=25:loss=1"]
scenarios: [tap-scan]
seeds: 30
first_seed: 7
scan: {model: dragon.ply, size: 0.3}
)",
                                  "s.yaml");
  EXPECT_EQ(study.name, "mine");
  EXPECT_THAT(study.profiles, ElementsAre("P4", "P0:delay=25:loss=1"));
  EXPECT_THAT(study.scenarios, ElementsAre("tap-scan"));
  EXPECT_EQ(study.seeds, 30u);
  EXPECT_EQ(study.first_seed, 7u);
  EXPECT_EQ(study.scan.model, "dragon.ply");
  EXPECT_EQ(study.scan.size, 0.3);
}

TEST(Study, ErrorsNameThePositionTheKeyTheValueFoundAndTheValueExpected) {
  EXPECT_EQ(error_of("name: s\nseeds: 0\n"), "s.yaml:2:8: seeds: found '0', expected a number from 1 to 10000");
  EXPECT_EQ(error_of("name: s\nscan: {model: x, sise: 1}\n"),
            "s.yaml:2:18: scan: unknown key 'sise', expected one of model, faces, size");
  EXPECT_THAT(error_of("name: s\nprofiles: P4\n"), HasSubstr("s.yaml:2:11: profiles: found 'P4', expected a list"));
  EXPECT_THAT(error_of("seeds: 3\n"), HasSubstr("key 'name' is missing"));
  EXPECT_THAT(error_of("3"), HasSubstr("found '3', expected a map of name, profiles, scenarios"));
}

TEST(Study, BeginsWithTheBaselineAndHasItOnce) {
  Study study;
  study.profiles = {"P4", "P0", "P6"};
  EXPECT_FALSE(check(study).empty());
  EXPECT_THAT(study.profiles, ElementsAre("P0", "P4", "P6"));
}

TEST(Study, HasEachLinkOnce) {
  Study study;
  study.profiles = {"P0", "P4", "P0", "P6", "P4"};
  EXPECT_FALSE(check(study).empty());
  EXPECT_THAT(study.profiles, ElementsAre("P0", "P4", "P6"));
}

/// The message with which a study of these scenarios is refused; empty if it is not.
std::string refusal_of(std::vector<std::string> scenarios) {
  Study study;
  study.scenarios = std::move(scenarios);
  try {
    (void)check(study);
  } catch (const client_sim::ScenarioError& error) {
    return error.what();
  }
  return "";
}

TEST(Study, RefusesExperimentsWithOneName) {
  const test_support::TemporaryFolder folder;
  const std::string copy = (folder.path() / "copy.yaml").string(), named = (folder.path() / "named.yaml").string();
  const std::string text = client_sim::built_in_scenario("tap-scan").text;
  std::ofstream{copy} << text;
  EXPECT_EQ(refusal_of({"tap-scan", copy}), "scenarios: found the name 'tap-scan' in '" + copy +
                                                "' and in 'tap-scan', expected a different 'name:' in each");
  std::ofstream{copy} << "name: mine" << text.substr(text.find('\n'));
  EXPECT_EQ(refusal_of({"tap-scan", copy}), "");
  for (const char* name : {"stiffness", "carry, channel"}) {
    std::ofstream{named} << "name: " << name << text.substr(text.find('\n'));
    EXPECT_EQ(refusal_of({named}), "scenarios: found the name '" + std::string{name} + "' in '" + named +
                                       "' and in the program, expected a different 'name:' in each");
  }
}

TEST(Study, RefusesValuesThatAMeasurementTakesFromOneUserIfTheyDiffer) {
  const test_support::TemporaryFolder folder;
  const std::string file = (folder.path() / "s.yaml").string();
  std::ofstream{file} << "name: s\nmeasures: lift\ntruth: analytic\nusers:\n"
                         "  - {name: ann, script: [{lift: {object: crate, height: 0.1}}]}\n"
                         "  - {name: bob, script: [{lift: {object: crate, height: 0.2}}]}\n";
  EXPECT_EQ(refusal_of({file}), "scenario 's': has actions lift with different values of 'height', expected one value");
  std::ofstream{file} << "name: s\nmeasures: forces\ntruth: analytic\nusers:\n"
                         "  - {name: ann, script: [{tap: {object: wall}}]}\n"
                         "  - {name: bob, radius: 0.01, script: [{tap: {object: wall}}]}\n";
  EXPECT_EQ(refusal_of({file}), "scenario 's': has users with different values of 'radius', expected one value");
}

TEST(Study, RefusesScenariosThatItCannotRun) {
  const test_support::TemporaryFolder folder;
  Study study;
  study.profiles = {"P99"};
  EXPECT_THROW((void)check(study), netem::LinkError);
  study = {};
  study.scenarios = {"demo"};
  EXPECT_THROW((void)check(study), client_sim::ScenarioError);  // the scenario measures nothing
  std::ofstream{folder.path() / "t.yaml"} << "name: t\nmeasures: forces\ntruth: analytic\ntool: stylus\n"
                                             "users:\n  - {name: ann, script: [{tap: {object: wall}}]}\n";
  study.scenarios = {(folder.path() / "t.yaml").string()};
  EXPECT_THROW((void)check(study), client_sim::ScenarioError);  // the ground truth of a tool on a box is not available
  study.scenarios = {"nowhere.yaml"};
  EXPECT_THROW((void)check(study), client_sim::ScenarioError);
}

TEST(Runs, ReportTheOthersIfOneFails) {
  Study study;
  study.seeds = 1;
  study.first_seed = 7;
  Experiments experiments;
  experiments.all.push_back({"tap",
                             Section::kForces,
                             0,
                             {"P0", "P4"},
                             1,
                             [](const netem::LinkSettings& link, std::uint64_t, const std::atomic<bool>&) {
                               if (link.name == "P4") throw std::runtime_error{"no base mesh"};
                               return ScenarioRun{};
                             }});
  std::vector<std::string> finished;
  RunnerSettings settings;
  settings.jobs = 1;
  settings.on_run = [&](const FinishedRun& run) { finished.push_back(run.run.profile); };
  std::string error;
  try {
    run_all(study, experiments, settings, std::atomic<bool>{false});
  } catch (const std::runtime_error& failure) {
    error = failure.what();
  }
  EXPECT_EQ(error, "tap over P4, seed 7: no base mesh");
  EXPECT_THAT(finished, ElementsAre("P0"));
}

}  // namespace
}  // namespace tactus::study
