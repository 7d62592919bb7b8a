#include "study/statistics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace tactus::study {
namespace {

TEST(Estimate, OfOneValueIsThatValue) {
  const Estimate single = estimate({3.5});
  EXPECT_EQ(single.count, 1u);
  EXPECT_EQ(single.mean, 3.5);
  EXPECT_EQ(single.low, 3.5);
  EXPECT_EQ(single.high, 3.5);
  EXPECT_EQ(estimate({}).count, 0u);
}

TEST(Estimate, OfTwoValuesReachesFromOneToTheOther) {
  // One of the four equally likely bootstrap samples contains the first value twice, and one the second value twice.
  const Estimate two = estimate({0, 1});
  EXPECT_EQ(two.mean, 0.5);
  EXPECT_EQ(two.low, 0);
  EXPECT_EQ(two.high, 1);
}

TEST(Estimate, HasTheConfidenceIntervalOfNormalValues) {
  std::mt19937_64 random{7};
  std::normal_distribution<double> normal{10, 2};
  std::vector<double> values(400);
  for (double& value : values) value = normal(random);
  const Estimate many = estimate(values);
  EXPECT_NEAR(many.high - many.low, 2 * 1.96 * 2 / std::sqrt(400), 0.04);
  EXPECT_LT(many.low, many.mean);
  EXPECT_LT(many.mean, many.high);
}

TEST(Estimate, CoversTheMeanInAboutNineteenOfTwentyCases) {
  std::mt19937_64 random{3};
  std::exponential_distribution<double> exponential{1};
  int covered = 0;
  for (int i = 0; i < 300; ++i) {
    std::vector<double> values(40);
    for (double& value : values) value = exponential(random);
    const Estimate found = estimate(values);
    covered += found.low <= 1 && 1 <= found.high ? 1 : 0;
  }
  EXPECT_NEAR(covered / 300.0, 0.93, 0.035);  // the percentile bootstrap of skewed values covers slightly less
}

}  // namespace
}  // namespace tactus::study
