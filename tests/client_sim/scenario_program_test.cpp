/// The program tactus-scenario.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client_sim/scenario.hpp"
#include "tests/support/process.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::client_sim {
namespace {

using e2e::Process;
using testing::HasSubstr;

TEST(ScenarioProgram, PrintsScenariosThatLoadAsTheBuiltInOnes) {
  const test_support::TemporaryFolder folder;
  for (const BuiltInScenario& built_in : built_in_scenarios()) {
    Process show{{TACTUS_SCENARIO, "show", built_in.name}};
    ASSERT_EQ(show.wait(), 0) << show.output();
    const std::string path = (folder.path() / built_in.name).string();
    test_support::write_bytes(path, show.output());
    const Scenario loaded = load_scenario(path), original = load_scenario(built_in.name);
    EXPECT_EQ(loaded.name, original.name);
    EXPECT_EQ(loaded.users.size(), original.users.size()) << built_in.name;
    EXPECT_EQ(loaded.digest, original.digest) << built_in.name << ": the digest is a hash of the whole text";
  }
}

TEST(ScenarioProgram, ListsEachBuiltInScenario) {
  Process list{{TACTUS_SCENARIO, "list"}};
  ASSERT_EQ(list.wait(), 0);
  for (const BuiltInScenario& built_in : built_in_scenarios()) EXPECT_THAT(list.output(), HasSubstr(built_in.name));
  EXPECT_THAT(list.output(), HasSubstr("touch            1 user, 8 s\n"));
}

TEST(ScenarioProgram, RefusesAnUnknownNameAndListsTheKnownOnes) {
  Process show{{TACTUS_SCENARIO, "show", "dmeo"}};
  EXPECT_EQ(show.wait(), 2);
  EXPECT_THAT(show.output(), HasSubstr("scenario 'dmeo': not a built-in one, expected one of touch, follow, lift, "));
}

}  // namespace
}  // namespace tactus::client_sim
