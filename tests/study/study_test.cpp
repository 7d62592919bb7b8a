#include "study/study.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "netem/profile.hpp"
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

}  // namespace
}  // namespace tactus::study
