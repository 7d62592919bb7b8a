#include "latency/result.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <random>

namespace tactus::latency {
namespace {

constexpr std::uint32_t kSeed = 20261121;
constexpr std::int64_t kUs = 1000, kMs = 1'000'000;

/// Pings at 1 kHz that take `forth` and `back` ns, all sent at the intended time.
Timestamps regular(double seconds, std::int64_t forth, std::int64_t back, std::uint32_t readers = 1) {
  Timestamps timestamps;
  timestamps.test.seconds = seconds;
  timestamps.test.readers = readers;
  timestamps.shares_clock = true;
  for (std::uint32_t i = 0; i < timestamps.test.ticks(); ++i) {
    const std::int64_t at = 1000 * kMs + i * kMs;
    timestamps.pings.push_back({at, at, true});
    for (std::uint32_t reader = 0; reader < readers; ++reader) {
      timestamps.arrivals.push_back({i, reader, at + forth});
      timestamps.echoes.push_back({i, reader, at + forth, at + forth, at + forth + back});
    }
  }
  return timestamps;
}

TEST(AResult, ReproducesConstantTimes) {
  const Result result = evaluate(regular(2, 30 * kUs, 50 * kUs, 3));
  EXPECT_EQ(result.expected, (2000u - warm_up(result.test)) * 3);
  EXPECT_EQ(result.half_round_trip.count, result.expected);
  EXPECT_DOUBLE_EQ(result.half_round_trip.p50, 40);
  EXPECT_DOUBLE_EQ(result.half_round_trip.max, 40);
  EXPECT_DOUBLE_EQ(result.age.p50, 30);
  EXPECT_EQ(result.clock_bound_us, 0);
  EXPECT_EQ(result.jitter_us, 0);
  EXPECT_EQ(result.lost + result.echoes_lost + result.reordered + result.duplicates + result.refused, 0u);
}

TEST(AResult, CountsABlockForEveryPingIntendedMeanwhile) {
  Timestamps timestamps = regular(10, 20 * kUs, 20 * kUs);
  // The sender is blocked for 200 ms at 5 s, then sends all due pings at once.
  for (std::uint32_t i = 5000; i < 5200; ++i) {
    const std::int64_t late = timestamps.pings[5200].intended_ns;
    timestamps.pings[i].sent_ns = late;
    timestamps.pings[i].waited = false;
    timestamps.arrivals[i].received_ns = late + 20 * kUs;
    timestamps.echoes[i] = {i, 0, late + 20 * kUs, late + 20 * kUs, late + 40 * kUs};
  }
  const Result result = evaluate(timestamps);
  EXPECT_NEAR(result.half_round_trip.max, 100'000 + 20, 1);
  EXPECT_GT(result.half_round_trip.p99, 50'000) << "2 % of the pings were blocked for 100 ms on average";
  EXPECT_DOUBLE_EQ(result.half_round_trip_sent.max, 20) << "hidden when time counts from the send call";
  EXPECT_EQ(result.timer.max, 0) << "it was not the timer";
}

TEST(AResult, CountsRefusedPingsWithoutTheWarmUp) {
  Timestamps timestamps = regular(2, 20 * kUs, 20 * kUs);
  const std::uint32_t first = warm_up(timestamps.test);
  for (const std::uint32_t refused : {first - 2, first - 1, first + 5}) timestamps.pings[refused].refused = true;
  EXPECT_EQ(evaluate(timestamps).refused, 1u);
}

TEST(AResult, CountsLossReorderingAndDuplicatesWithoutTheWarmUp) {
  Timestamps timestamps = regular(2, 20 * kUs, 20 * kUs);
  const std::uint32_t first = warm_up(timestamps.test);
  std::swap(timestamps.arrivals[first + 10], timestamps.arrivals[first + 11]);  // one ping overtakes
  timestamps.arrivals.push_back(timestamps.arrivals[first + 20]);               // one ping arrives twice
  timestamps.echoes.push_back(timestamps.echoes[first + 20]);
  const auto remove = [](auto& list, std::uint32_t sequence) {
    list.erase(std::remove_if(list.begin(), list.end(), [&](const auto& s) { return s.sequence == sequence; }),
               list.end());
  };
  for (const std::uint32_t lost : {first + 100, first + 101, first + 102, first - 1}) {
    remove(timestamps.arrivals, lost);
    remove(timestamps.echoes, lost);
  }
  remove(timestamps.echoes, first + 200);  // only the echo
  const Result result = evaluate(timestamps);
  EXPECT_EQ(result.lost, 3u);
  EXPECT_EQ(result.echoes_lost, 1u);
  EXPECT_EQ(result.reordered, 1u);
  EXPECT_EQ(result.duplicates, 1u);
  std::uint32_t missing = 0;
  for (const TimeBin& bin : result.bins) missing += bin.missing;
  EXPECT_EQ(missing, 4u);
}

TEST(AResult, HasAnAgeOfInformationThatGrowsWithEveryLostPing) {
  Timestamps timestamps = regular(20, 50 * kUs, 50 * kUs);
  const Result whole = evaluate(timestamps);
  EXPECT_NEAR(whole.age_of_information.p50, 550, 60) << "between 50 and 1050 us, evenly";
  EXPECT_NEAR(whole.age_of_information.max, 1050, 100);
  timestamps.arrivals.erase(timestamps.arrivals.begin() + 5000, timestamps.arrivals.begin() + 5009);
  EXPECT_NEAR(evaluate(timestamps).age_of_information.max, 10'050, 100) << "nine in a row are lost";
  std::swap(timestamps.arrivals[8000], timestamps.arrivals[8001]);  // the older one arrives late and changes nothing
  timestamps.arrivals[8001].received_ns = timestamps.arrivals[8000].received_ns + 1;
  EXPECT_NEAR(evaluate(timestamps).age_of_information.max, 10'050, 100);
}

TEST(AResult, IgnoresNumbersThatWereNeverSent) {
  Timestamps timestamps = regular(2, 20 * kUs, 20 * kUs);
  timestamps.arrivals.push_back({999'999, 0, 5});
  timestamps.arrivals.push_back({1000, 77, 5});
  timestamps.echoes.push_back({999'999, 0, 5, 5, 5});
  timestamps.echoes.push_back({1000, 77, 5, 5, 5});
  const Result result = evaluate(timestamps);
  EXPECT_EQ(result.age.count, result.expected);
  EXPECT_EQ(result.half_round_trip.count, result.expected);
}

TEST(AResult, HasTheAgeOfTwoClocksWithinItsBound) {
  std::mt19937 random{kSeed};
  std::exponential_distribution<double> extra{1.0 / 200};  // us, each direction
  Timestamps timestamps;
  timestamps.test.seconds = 5;
  const auto other_clock = [](std::int64_t ours) {  // 3 s ahead, 50 ppm fast
    return ours + 3'000'000'000 + (ours - 1000 * kMs) / 20'000;
  };
  double worst = 0;
  std::vector<double> truth;
  for (std::uint32_t i = 0; i < timestamps.test.ticks(); ++i) {
    const std::int64_t at = 1000 * kMs + i * kMs;
    const auto forth = static_cast<std::int64_t>((300 + extra(random)) * 1e3);
    const auto back = static_cast<std::int64_t>((300 + extra(random)) * 1e3);
    timestamps.pings.push_back({at, at, true});
    timestamps.arrivals.push_back({i, 0, other_clock(at + forth)});
    timestamps.echoes.push_back({i, 0, other_clock(at + forth), other_clock(at + forth), at + forth + back});
    if (i >= warm_up(timestamps.test)) truth.push_back(static_cast<double>(forth) * 1e-3);
    worst = std::max(worst, static_cast<double>(forth) * 1e-3);
  }
  const Summary expected = summarise(truth);
  const Result result = evaluate(timestamps);
  EXPECT_GT(result.clock_bound_us, 299) << "half of the shortest round trip cannot be told apart";
  EXPECT_LT(result.clock_bound_us, 400);
  EXPECT_NEAR(result.age.p50, expected.p50, result.clock_bound_us);
  EXPECT_NEAR(result.age.max, worst, result.clock_bound_us);
  EXPECT_NEAR(result.age.p50, expected.p50, 60) << "both directions are alike, so the error is below its bound";
}

}  // namespace
}  // namespace tactus::latency
