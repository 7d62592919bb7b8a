#include "bench/figures.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "bench/bench_main.hpp"
#include "bench/counts.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::bench {
namespace {

const Subject kSubject{"none", 0, 0, ""};

int exit_status(const Report& report) { return report.finish("test", "scripts/bench test", ""); }

TEST(Report, HasExitStatus1ExactlyWhenABoundFallsShort) {
  Report holds{kSubject};
  holds.add_at_most("a", {"all", 3}, "us", 5, 5);
  holds.add_at_least("b", {"all", 3}, "times", 300, 300);
  EXPECT_EQ(exit_status(holds), 0);
  Report above{kSubject};
  above.add_at_most("a", {"all", 3}, "us", 5.001, 5);
  EXPECT_EQ(exit_status(above), 1);
  Report below{kSubject};
  below.add_at_least("b", {"all", 3}, "times", 299, 300);
  EXPECT_EQ(exit_status(below), 1);
}

TEST(Report, FallsShortWithoutSamples) {
  Report percentile{kSubject};
  percentile.add_percentiles("a", "all", "us", Samples{}, {{0.99, 1e9}});
  EXPECT_EQ(exit_status(percentile), 1);
  Report count{kSubject};
  count.add_at_most("differences", {"compared", 0}, "", 0, 0);
  EXPECT_EQ(exit_status(count), 1);
}

TEST(Report, FallsShortWithoutRows) {
  EXPECT_EQ(exit_status(Report{kSubject}), 1);
  Report row{kSubject};
  row.add_value("a", {"all", 1}, "us", 5);
  EXPECT_EQ(exit_status(row), 0);
}

TEST(DoubledCounts, AlwaysEndWithTheLast) {
  using testing::ElementsAre;
  EXPECT_THAT(doubled_counts(4, 32), ElementsAre(4, 8, 16, 32));
  EXPECT_THAT(doubled_counts(3, 20), ElementsAre(3, 6, 12, 20));
  EXPECT_THAT(doubled_counts(40, 32), ElementsAre(32));
  EXPECT_THAT(doubled_counts(0, 1), ElementsAre(1));
}

TEST(Report, CountsUnfinishedWorkAsLate) {
  Samples samples;
  for (int i = 0; i < 98; ++i) samples.add(1);
  samples.add(kUnfinished);
  samples.add(kUnfinished);
  Report median{kSubject};
  median.add_percentiles("a", "all", "ms", samples, {{0.5, 2}});
  EXPECT_EQ(exit_status(median), 0);
  Report tail{kSubject};
  tail.add_percentiles("a", "all", "ms", samples, {{0.99, 1e300}});
  EXPECT_EQ(exit_status(tail), 1);
  Report ratio{kSubject};
  ratio.add_at_least("theirs / ours", {"all", 3}, "times", kUnfinished, 2);
  EXPECT_EQ(exit_status(ratio), 1);
}

TEST(Report, FallsShortIfASampleIsNotANumber) {
  for (const std::size_t at : {0, 1, 2}) {
    Samples samples;
    for (std::size_t i = 0; i < 3; ++i) samples.add(i == at ? std::nan("") : 1);
    for (const double share : {0.0, 0.5, 1.0}) {
      Report report{kSubject};
      report.add_at_most("a", {"all", samples.size()}, "ms", samples.percentile(share), 2);
      EXPECT_EQ(exit_status(report), 1) << "sample " << at << ", share " << share;
    }
  }
}

TEST(Figures, ARatioOfUnfinishedWorkIsUnfinished) {
  EXPECT_EQ(ratio(3, 2), 1.5);
  EXPECT_EQ(ratio(3, kUnfinished), kUnfinished) << "not zero, which would be below each upper bound";
  EXPECT_EQ(ratio(kUnfinished, kUnfinished), kUnfinished);
  EXPECT_EQ(ratio(std::nan(""), 2), kUnfinished);
  EXPECT_EQ(ratio(3, 0), kUnfinished);
}

TEST(Report, RefusesAFileThatCannotBeWritten) {
  const Report report{kSubject};
  EXPECT_THROW(static_cast<void>(report.finish("test", "", "/nowhere/figures.json")), std::runtime_error);
}

TEST(Report, WritesTheRowsOfItsTable) {
  Report report{kSubject};
  report.set_virtual_time(true);
  report.add_at_most("a", {"all", 3}, "us", 6, 5);
  report.set_virtual_time(false);
  report.add_value("b", {"none", 0}, "us", std::nan(""));
  const test_support::TemporaryFolder folder;
  const std::string file = (folder.path() / "rows.json").string();
  EXPECT_EQ(report.finish("test", "scripts/bench test --quick", file), 1);
  std::ifstream in{file};
  const nlohmann::json rows = nlohmann::json::parse(in).at("rows");
  ASSERT_EQ(rows.size(), 2u);
  EXPECT_EQ(rows[0], nlohmann::json::parse(R"({"bench": "test", "command": "scripts/bench test --quick", "figure": "a",
      "population": "all", "n": 3, "bound": "<= 5", "value": 6.0, "unit": "us", "text": "6 us",
      "verdict": "falls short", "virtual_time": true})"));
  EXPECT_TRUE(rows[1].at("value").is_null());
  EXPECT_EQ(rows[1].at("text"), "no samples");
  EXPECT_EQ(rows[1].at("verdict"), "no bound");
  EXPECT_FALSE(rows[1].at("virtual_time").get<bool>());
}

int main_of(std::vector<const char*> arguments, const std::function<Report()>& run) {
  App app{"test", "Nothing", "does less"};
  arguments.insert(arguments.begin(), "tactus-bench-test");
  return bench_main(app, static_cast<int>(arguments.size()), const_cast<char**>(arguments.data()), run);
}

TEST(BenchMain, HasTheExitStatusOfTheRun) {
  const auto run_with = [](double value) {
    return [value] {
      Report report{kSubject};
      report.add_at_most("a", {"all", 1}, "us", value, 2);
      return report;
    };
  };
  EXPECT_EQ(main_of({}, run_with(1)), 0);
  EXPECT_EQ(main_of({"--quick"}, run_with(3)), 1);
  EXPECT_EQ(main_of({"--help"}, run_with(3)), 0);
  EXPECT_EQ(main_of({"--unknown"}, run_with(1)), 2);
  EXPECT_EQ(main_of({}, []() -> Report { throw std::runtime_error{"no model"}; }), 2);
  EXPECT_EQ(main_of({}, []() -> Report { throw Interrupted{}; }), 130);
}

}  // namespace
}  // namespace tactus::bench
