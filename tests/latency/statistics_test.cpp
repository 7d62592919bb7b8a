#include "latency/statistics.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

namespace tactus::latency {
namespace {

constexpr std::uint32_t kStatisticsSeed = 20261121;

TEST(ASummary, HasTheKnownPercentilesAndIsNotANumberWithoutValues) {
  std::vector<double> values{5, 1, 4, 2, 3, 9, 7, 8, 6, 10};
  const Summary summary = summarise(values);
  EXPECT_EQ(summary.count, 10u);
  EXPECT_DOUBLE_EQ(summary.mean, 5.5);
  EXPECT_EQ(summary.p50, 5);
  EXPECT_EQ(summary.p90, 9);
  EXPECT_EQ(summary.p99, 10);
  EXPECT_EQ(summary.max, 10);
  std::vector<double> none;
  EXPECT_EQ(summarise(none).count, 0u);
  EXPECT_TRUE(std::isnan(summarise(none).p99));
}

TEST(ALoad, HasALowRateIfItStalls) {
  constexpr std::int64_t kSecond = 1'000'000'000;
  EXPECT_DOUBLE_EQ(bytes_per_s(1000, 3 * kSecond, 8 * kSecond, 5), 200);
  EXPECT_DOUBLE_EQ(bytes_per_s(100, 3 * kSecond, 3 * kSecond + kSecond / 2, 5), 20) << "stalls after half a second";
  EXPECT_DOUBLE_EQ(bytes_per_s(1200, 3 * kSecond, 9 * kSecond, 5), 200) << "the load ends after the test";
  EXPECT_EQ(bytes_per_s(0, 0, 0, 5), 0) << "no arrival";
}

TEST(ATally, AgreesWithASetOfSequenceNumbers) {
  std::mt19937 random{kStatisticsSeed};
  for (int round = 0; round < 50; ++round) {
    constexpr std::uint32_t kExpected = 200;
    SequenceTally tally{kExpected};
    std::set<std::uint32_t> received;
    std::uint32_t duplicates = 0, reordered = 0;
    for (int i = 0; i < 300; ++i) {
      const std::uint32_t sequence = std::uniform_int_distribution<std::uint32_t>{0, kExpected + 20}(random);
      const bool first = sequence < kExpected && received.count(sequence) == 0;
      if (sequence < kExpected && !first) ++duplicates;
      if (first && received.upper_bound(sequence) != received.end()) ++reordered;
      if (first) received.insert(sequence);
      ASSERT_EQ(tally.add(sequence), first);
    }
    ASSERT_EQ(tally.unique(), received.size());
    ASSERT_EQ(tally.lost(), kExpected - received.size());
    ASSERT_EQ(tally.duplicates(), duplicates);
    ASSERT_EQ(tally.reordered(), reordered);
  }
}

TEST(InterarrivalJitterOfRfc3550, FollowsTheFormulaOfTheRfc) {
  std::mt19937 random{kStatisticsSeed};
  InterarrivalJitter jitter;
  double expected = 0;
  std::int64_t previous_sent = 0, previous_received = 0;
  for (int i = 0; i < 1000; ++i) {
    const std::int64_t sent = i * 1'000'000;
    const std::int64_t received = sent + std::uniform_int_distribution<int>{50'000, 900'000}(random);
    jitter.add(sent, received);
    if (i > 0) {
      const double difference = static_cast<double>((received - previous_received) - (sent - previous_sent));
      expected += (std::abs(difference) - expected) / 16;
    }
    previous_sent = sent;
    previous_received = received;
  }
  EXPECT_NEAR(jitter.us(), expected * 1e-3, 1e-6);
}

TEST(InterarrivalJitterOfRfc3550, IsZeroIfEverySampleHasTheSameTransit) {
  InterarrivalJitter jitter;
  for (int i = 0; i < 100; ++i) jitter.add(i * 777, i * 777 + 123'456'789);
  EXPECT_EQ(jitter.us(), 0);
}

}  // namespace
}  // namespace tactus::latency
