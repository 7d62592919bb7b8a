#include "latency/result.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <random>

#include "tests/support/constants.hpp"

namespace tactus::latency {
namespace {

constexpr std::uint32_t kResultSeed = 20261121;

/// Pings at 1 kHz, all sent at the intended time. `ping_ns`: transit of each ping. `echo_ns`: transit of each echo.
Timestamps constant_times(double seconds, std::int64_t ping_ns, std::int64_t echo_ns, std::uint32_t readers = 1) {
  Timestamps timestamps;
  timestamps.test.seconds = seconds;
  timestamps.test.readers = readers;
  timestamps.shares_clock = true;
  for (std::uint32_t i = 0; i < timestamps.test.ticks(); ++i) {
    const std::int64_t sent_ns = 1000 * kMs + i * kMs;
    const std::int64_t arrived_ns = sent_ns + ping_ns;
    timestamps.pings.push_back({sent_ns, sent_ns, true});
    for (std::uint32_t reader = 0; reader < readers; ++reader) {
      timestamps.arrivals.push_back({i, reader, arrived_ns});
      timestamps.echoes.push_back({i, reader, arrived_ns, arrived_ns, arrived_ns + echo_ns});
    }
  }
  return timestamps;
}

TEST(AResult, ReproducesConstantTimes) {
  const Result result = evaluate(constant_times(2, 30 * kUs, 50 * kUs, 3));
  EXPECT_EQ(result.expected, (2000u - warm_up(result.test)) * 3);
  EXPECT_EQ(result.half_round_trip.count, result.expected);
  EXPECT_DOUBLE_EQ(result.half_round_trip.p50, 40);
  EXPECT_DOUBLE_EQ(result.half_round_trip.max, 40);
  EXPECT_DOUBLE_EQ(result.age.p50, 30);
  EXPECT_EQ(result.clock_bound_us, 0);
  EXPECT_EQ(result.jitter_us, 0);
  EXPECT_EQ(result.lost + result.echoes_lost + result.reordered + result.duplicates + result.refused, 0u);
}

TEST(AResult, CountsTheDelayOfABlockedSenderForEveryPingThatWasDue) {
  Timestamps timestamps = constant_times(10, 20 * kUs, 20 * kUs);
  // The sender is blocked for 200 ms at 5 s, then sends all due pings at once.
  for (std::uint32_t i = 5000; i < 5200; ++i) {
    const std::int64_t sent_ns = timestamps.pings[5200].intended_ns;
    timestamps.pings[i].sent_ns = sent_ns;
    timestamps.pings[i].waited = false;
    timestamps.arrivals[i].received_ns = sent_ns + 20 * kUs;
    timestamps.echoes[i] = {i, 0, sent_ns + 20 * kUs, sent_ns + 20 * kUs, sent_ns + 40 * kUs};
  }
  const Result result = evaluate(timestamps);
  EXPECT_NEAR(result.half_round_trip.max, 100'000 + 20, 1);
  EXPECT_GT(result.half_round_trip.p99, 50'000) << "2 % of the pings were blocked for 100 ms on average";
  EXPECT_DOUBLE_EQ(result.half_round_trip_sent.max, 20) << "times from the send call do not show the block";
  EXPECT_EQ(result.timer.max, 0) << "the timer was not late";
}

TEST(AResult, CountsRefusedPingsWithoutTheWarmUp) {
  Timestamps timestamps = constant_times(2, 20 * kUs, 20 * kUs);
  const std::uint32_t first = warm_up(timestamps.test);
  for (const std::uint32_t refused : {first - 2, first - 1, first + 5}) timestamps.pings[refused].refused = true;
  EXPECT_EQ(evaluate(timestamps).refused, 1u);
}

TEST(AResult, CountsLossReorderingAndDuplicatesWithoutTheWarmUp) {
  Timestamps timestamps = constant_times(2, 20 * kUs, 20 * kUs);
  const std::uint32_t first = warm_up(timestamps.test);
  std::swap(timestamps.arrivals[first + 10], timestamps.arrivals[first + 11]);  // one ping overtakes another
  timestamps.arrivals.push_back(timestamps.arrivals[first + 20]);               // one ping arrives twice
  timestamps.echoes.push_back(timestamps.echoes[first + 20]);
  const auto remove = [](auto& list, std::uint32_t sequence) {
    list.erase(
        std::remove_if(list.begin(), list.end(), [&](const auto& sample) { return sample.sequence == sequence; }),
        list.end());
  };
  for (const std::uint32_t lost : {first + 100, first + 101, first + 102, first - 1}) {
    remove(timestamps.arrivals, lost);
    remove(timestamps.echoes, lost);
  }
  remove(timestamps.echoes, first + 200);  // the ping arrives, its echo does not
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
  Timestamps timestamps = constant_times(20, 50 * kUs, 50 * kUs);
  const Result complete = evaluate(timestamps);
  EXPECT_NEAR(complete.age_of_information.p50, 550, 60) << "uniform between 50 and 1050 us";
  EXPECT_NEAR(complete.age_of_information.max, 1050, 100);
  timestamps.arrivals.erase(timestamps.arrivals.begin() + 5000, timestamps.arrivals.begin() + 5009);
  EXPECT_NEAR(evaluate(timestamps).age_of_information.max, 10'050, 100) << "nine consecutive pings are lost";
  // An older ping that arrives late does not change the age.
  std::swap(timestamps.arrivals[8000], timestamps.arrivals[8001]);
  timestamps.arrivals[8001].received_ns = timestamps.arrivals[8000].received_ns + 1;
  EXPECT_NEAR(evaluate(timestamps).age_of_information.max, 10'050, 100);
}

TEST(AResult, HasAnAgeOfInformationThatGrowsUntilTheEndIfNothingArrives) {
  Timestamps timestamps = constant_times(20, 50 * kUs, 50 * kUs);
  timestamps.arrivals.resize(timestamps.arrivals.size() / 2);
  const Result half = evaluate(timestamps);
  EXPECT_NEAR(half.age_of_information.max, 10'000'000, 1100) << "nothing arrives in the last 10 s";
  EXPECT_GT(half.age_of_information.p90, 7'000'000);
  timestamps.arrivals.clear();
  EXPECT_TRUE(std::isinf(evaluate(timestamps).age_of_information.p50));
}

TEST(AResult, IgnoresSequenceAndReaderNumbersThatWereNeverSent) {
  Timestamps timestamps = constant_times(2, 20 * kUs, 20 * kUs);
  timestamps.arrivals.push_back({999'999, 0, 5});
  timestamps.arrivals.push_back({1000, 77, 5});
  timestamps.echoes.push_back({999'999, 0, 5, 5, 5});
  timestamps.echoes.push_back({1000, 77, 5, 5, 5});
  const Result result = evaluate(timestamps);
  EXPECT_EQ(result.age.count, result.expected);
  EXPECT_EQ(result.half_round_trip.count, result.expected);
}

TEST(AResult, HasAnAgeBetweenTwoClocksThatIsCorrectWithinItsBound) {
  std::mt19937 random{kResultSeed};
  std::exponential_distribution<double> jitter{1.0 / 200};  // us, in each direction
  Timestamps timestamps;
  timestamps.test.seconds = 5;
  const auto other_clock = [](std::int64_t local_ns) {  // 3 s ahead and 50 ppm fast
    return local_ns + 3'000'000'000 + (local_ns - 1000 * kMs) / 20'000;
  };
  double max_age_us = 0;
  std::vector<double> true_ages_us;
  for (std::uint32_t i = 0; i < timestamps.test.ticks(); ++i) {
    const std::int64_t sent_ns = 1000 * kMs + i * kMs;
    const auto ping_ns = static_cast<std::int64_t>((300 + jitter(random)) * 1e3);
    const auto echo_ns = static_cast<std::int64_t>((300 + jitter(random)) * 1e3);
    const std::int64_t arrived_other_ns = other_clock(sent_ns + ping_ns);
    timestamps.pings.push_back({sent_ns, sent_ns, true});
    timestamps.arrivals.push_back({i, 0, arrived_other_ns});
    timestamps.echoes.push_back({i, 0, arrived_other_ns, arrived_other_ns, sent_ns + ping_ns + echo_ns});
    const double age_us = static_cast<double>(ping_ns) * 1e-3;
    if (i >= warm_up(timestamps.test)) true_ages_us.push_back(age_us);
    max_age_us = std::max(max_age_us, age_us);
  }
  const Summary expected = summarise(true_ages_us);
  const Result result = evaluate(timestamps);
  EXPECT_GT(result.clock_bound_us, 299) << "the offset is uncertain by half of the shortest round trip";
  EXPECT_LT(result.clock_bound_us, 400);
  EXPECT_NEAR(result.age.p50, expected.p50, result.clock_bound_us);
  EXPECT_NEAR(result.age.max, max_age_us, result.clock_bound_us);
  EXPECT_NEAR(result.age.p50, expected.p50, 60) << "both directions are equally slow, so the error is below its bound";
}

}  // namespace
}  // namespace tactus::latency
