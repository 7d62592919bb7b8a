/// Tests percentiles by nearest rank, of sorted values and of samples in any order.
#include "session/percentile.hpp"

#include <gtest/gtest.h>

#include <random>

namespace tactus::session {
namespace {

constexpr std::uint32_t kSeed = 20261121;

TEST(Percentile, IsTheSmallestValueThatTheShareOfSamplesDoesNotExceed) {
  std::mt19937 random{kSeed};
  for (int round = 0; round < 200; ++round) {
    std::vector<double> values(std::uniform_int_distribution<std::size_t>{1, 300}(random));
    for (double& value : values) value = std::uniform_int_distribution<int>{0, 40}(random);
    std::vector<double> sorted = values;
    std::sort(sorted.begin(), sorted.end());
    Samples<> samples;
    for (const double value : values) samples.add(value);
    for (const double share : {0.0, 0.01, 0.5, 0.9, 0.99, 0.999, 1.0}) {
      const double found = percentile(sorted, share);
      ASSERT_EQ(samples.percentile(share), found);
      const auto share_up_to = [&](double limit) {
        return static_cast<double>(
                   std::count_if(values.begin(), values.end(), [&](double value) { return value <= limit; })) /
               static_cast<double>(values.size());
      };
      ASSERT_GE(share_up_to(found), share - 1e-9) << share << ", seed " << kSeed;
      for (const double smaller : values) {
        if (smaller < found) {
          ASSERT_LT(share_up_to(smaller), share + 1e-9) << share << ", seed " << kSeed;
        }
      }
    }
  }
}

TEST(Percentile, Rank99Point9OfAThousandSamplesIsTheSecondLargest) {
  std::vector<double> values(1000);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<double>(i);
  EXPECT_EQ(percentile(values, 0.999), 998);
}

TEST(Percentile, OfNoSamplesIsNotANumber) {
  const Samples<> none;
  const std::vector<double> empty;
  for (const double value : {none.percentile(0.5), none.max(), none.mean(), percentile(empty, 0.5)}) {
    EXPECT_FALSE(value <= 1e300);
    EXPECT_FALSE(value >= -1e300);
  }
}

TEST(Percentile, IncludesASampleAddedAfterAQuery) {
  Samples<> samples;
  samples.add(1);
  EXPECT_EQ(samples.max(), 1);
  samples.add(3);
  samples.add(2);
  EXPECT_EQ(samples.max(), 3);
  EXPECT_DOUBLE_EQ(samples.mean(), 2);
}

TEST(Percentile, WithALimitedNumberOfSamplesDropsTheOldest) {
  Samples<std::uint32_t> newest{3};
  for (const std::uint32_t value : {9u, 1u, 2u, 3u}) newest.add(value);
  EXPECT_EQ(newest.size(), 3u);
  EXPECT_EQ(newest.max(), 3);
  EXPECT_EQ(newest.percentile(0), 1);
}

TEST(Percentile, WithALimitedNumberOfSamplesTakesMemoryOnlyAtFirst) {
  constexpr std::size_t kSamples = 1000;
  Samples<> newest{kSamples};
  const double* const at_first = newest.values().data();
  for (std::size_t i = 0; i < 2 * kSamples; ++i) newest.add(static_cast<double>(i));
  EXPECT_EQ(newest.values().data(), at_first);
}

TEST(Percentile, WithALimitOfNoSamplesStoresNone) {
  Samples<> none{0};
  none.add(1);
  EXPECT_TRUE(none.empty());
}

}  // namespace
}  // namespace tactus::session
