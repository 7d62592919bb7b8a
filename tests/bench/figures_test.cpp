#include "bench/figures.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

namespace tactus::bench {
namespace {

TEST(Samples, PercentilesAreNearestRanksWhateverTheOrder) {
  std::vector<int> values(1000);
  std::iota(values.begin(), values.end(), 1);
  std::shuffle(values.begin(), values.end(), std::mt19937{7});
  Samples samples;
  for (const int v : values) samples.add(v);
  EXPECT_EQ(samples.percentile(50), 500);
  EXPECT_EQ(samples.percentile(99), 990);
  EXPECT_EQ(samples.percentile(99.9), 999);
  EXPECT_EQ(samples.max(), 1000);
  EXPECT_DOUBLE_EQ(samples.mean(), 500.5);
}

TEST(Samples, ASampleAddedAfterAPercentileCounts) {
  Samples samples;
  samples.add(1);
  EXPECT_EQ(samples.max(), 1);
  samples.add(3);
  samples.add(2);
  EXPECT_EQ(samples.max(), 3);
}

TEST(Report, EndsWithOneExactlyWhenABoundFallsShort) {
  const Subject subject{"test", "none", 0, 0, ""};
  Report holds{subject};
  holds.at_most("a", "all", "us", 5, 5);
  holds.at_least("b", "all", "times", 300, 300);
  EXPECT_EQ(holds.finish(""), 0);
  Report above{subject};
  above.at_most("a", "all", "us", 5.001, 5);
  EXPECT_EQ(above.finish(""), 1);
  Report below{subject};
  below.at_least("b", "all", "times", 299, 300);
  EXPECT_EQ(below.finish(""), 1);
}

TEST(Report, RefusesAFileThatCannotBeWritten) {
  const Report report{Subject{"test", "none", 0, 0, ""}};
  EXPECT_THROW(static_cast<void>(report.finish("/nowhere/figures.json")), std::runtime_error);
}

}  // namespace
}  // namespace tactus::bench
