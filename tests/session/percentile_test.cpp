// Percentiles by nearest rank, of sorted values and of samples in any order.
#include "session/percentile.hpp"

#include <gtest/gtest.h>

#include <random>

namespace tactus::session {
namespace {

constexpr std::uint32_t kSeed = 20261121;

TEST(Percentile, IsTheSmallestValueThatEnoughDoNotExceed) {
  std::mt19937 random{kSeed};
  for (int round = 0; round < 200; ++round) {
    std::vector<double> values(std::uniform_int_distribution<std::size_t>{1, 300}(random));
    for (double& v : values) v = std::uniform_int_distribution<int>{0, 40}(random);
    std::vector<double> sorted = values;
    std::sort(sorted.begin(), sorted.end());
    Samples<> samples;
    for (const double v : values) samples.add(v);
    for (const double share : {0.0, 0.01, 0.5, 0.9, 0.99, 0.999, 1.0}) {
      const double found = percentile(sorted, share);
      ASSERT_EQ(samples.percentile(share), found);
      const auto not_above = [&](double limit) {
        return static_cast<double>(std::count_if(values.begin(), values.end(), [&](double v) { return v <= limit; })) /
               static_cast<double>(values.size());
      };
      ASSERT_GE(not_above(found), share - 1e-9) << share << ", seed " << kSeed;
      for (const double smaller : values) {
        if (smaller < found) {
          ASSERT_LT(not_above(smaller), share + 1e-9) << share << ", seed " << kSeed;
        }
      }
    }
  }
}

TEST(Percentile, OfAThousandAtThreeNinesIsTheSecondLargest) {
  std::vector<double> values(1000);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<double>(i);
  EXPECT_EQ(percentile(values, 0.999), 998);
}

TEST(Percentile, OfNoSamplesHoldsNoBound) {
  const Samples<> none;
  const std::vector<double> empty;
  for (const double value : {none.percentile(0.5), none.max(), none.mean(), percentile(empty, 0.5)}) {
    EXPECT_FALSE(value <= 1e300);
    EXPECT_FALSE(value >= -1e300);
  }
}

TEST(Percentile, CountsASampleAddedLater) {
  Samples<> samples;
  samples.add(1);
  EXPECT_EQ(samples.max(), 1);
  samples.add(3);
  samples.add(2);
  EXPECT_EQ(samples.max(), 3);
  EXPECT_DOUBLE_EQ(samples.mean(), 2);
}

TEST(Percentile, OfTheNewestForgetsTheOldest) {
  Samples<std::uint32_t> newest{3};
  for (const std::uint32_t v : {9u, 1u, 2u, 3u}) newest.add(v);
  EXPECT_EQ(newest.size(), 3u);
  EXPECT_EQ(newest.max(), 3);
  EXPECT_EQ(newest.percentile(0), 1);
}

}  // namespace
}  // namespace tactus::session
