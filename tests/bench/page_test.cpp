// Tests that the page of benchmarks first lists the rows that fall short, and then has one table for each benchmark.
#include "bench/page.hpp"

#include <gmock/gmock.h>

#include "bench/figures.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::size_t count_of(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (std::size_t found = 0; (found = text.find(part, found)) != std::string::npos; ++found) ++count;
  return count;
}

TEST(Page, ListsShortfallsFirstAndEveryRowInItsTable) {
  const test_support::TemporaryFolder folder;
  Report first{{"a|b", 0, 0, "settings"}}, second{{"c", 0, 0, ""}};
  first.add_at_most("slow", {"all cycles", 7}, "us", 6, 5);
  first.add_at_least("fast", {"all cycles", 7}, "us", 6, 5);
  second.set_virtual_time(true);
  second.add_value("free", {"runs", 2}, "", 1);
  EXPECT_EQ(first.finish("one", "scripts/bench one", (folder.path() / "one.json").string()), 1);
  EXPECT_EQ(second.finish("two", "scripts/bench two", (folder.path() / "two.json").string()), 0);
  const auto runs = read_runs(folder.path().string());
  ASSERT_EQ(runs.size(), 2u);
  EXPECT_THAT(shortfalls(runs), ElementsAre("scripts/bench one: slow, all cycles (n 7): 6 us, bound <= 5"));
  const std::string text = page(runs);
  const std::string slow = "| slow | all cycles | 7 | <= 5 | 6 us | falls short |\n";
  const std::string shortfall = "| scripts/bench one " + slow;
  EXPECT_EQ(count_of(text, slow), 2u);
  EXPECT_EQ(count_of(text, shortfall), 1u);
  EXPECT_LT(text.find(shortfall), text.find("## scripts/bench one"));
  EXPECT_EQ(count_of(text, "| fast | all cycles | 7 | >= 5 | 6 us | holds |\n"), 1u);
  EXPECT_EQ(count_of(text, "| free | runs, virtual time | 2 | | 1 | no bound |\n"), 1u);
}

TEST(Page, RefusesAnEmptyFolderAndRunsOfSeveralCommits) {
  const test_support::TemporaryFolder folder;
  EXPECT_THROW(static_cast<void>(read_runs(folder.path().string())), std::runtime_error);
  Report report{{"a", 0, 0, ""}};
  report.add_value("free", {"runs", 2}, "", 1);
  EXPECT_EQ(report.finish("one", "scripts/bench one", (folder.path() / "one.json").string()), 0);
  auto runs = read_runs(folder.path().string());
  runs.push_back(runs.front());
  EXPECT_THAT(page(runs), HasSubstr("None."));
  runs.back()["build"]["commit"] = "0000000";
  EXPECT_THROW(static_cast<void>(page(runs)), std::runtime_error);
}

}  // namespace
}  // namespace tactus::bench
