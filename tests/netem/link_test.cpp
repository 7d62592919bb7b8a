#include "netem/link.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <deque>
#include <numeric>
#include <vector>

#include "tests/support/constants.hpp"

namespace tactus::netem {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr std::uint64_t kSeed = 20260703;
constexpr std::size_t kFrame = 1000;

/// Returns the delays in ms of `count` frames, of which one arrives every `period_ns`. The delay of a lost frame is
/// NaN.
std::vector<double> delays(Link& link, int count, std::int64_t period_ns, std::size_t bytes = kFrame) {
  std::vector<double> delays_ms;
  for (int i = 0; i < count; ++i) {
    const auto departure = link.departure(i * period_ns, bytes);
    delays_ms.push_back(departure ? static_cast<double>(*departure - i * period_ns) * 1e-6 : NAN);
  }
  return delays_ms;
}

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double standard_deviation(const std::vector<double>& values) {
  const double average = mean(values);
  double sum = 0;
  for (const double v : values) sum += (v - average) * (v - average);
  return std::sqrt(sum / static_cast<double>(values.size()));
}

/// Kolmogorov distance of `values` from a normal distribution.
double distance_from_normal(std::vector<double> values, double average, double sd) {
  std::sort(values.begin(), values.end());
  double max_distance = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double expected_share = 0.5 * std::erfc(-(values[i] - average) / (sd * std::sqrt(2.0)));
    max_distance = std::max(
        max_distance, std::abs(expected_share - (static_cast<double>(i) + 0.5) / static_cast<double>(values.size())));
  }
  return max_distance;
}

TEST(ALink, PassesFramesWithoutDelayByDefault) {
  Link link{{}, kSeed};
  for (std::int64_t at : {0, 5, 5, 1000}) EXPECT_EQ(link.departure(at, kFrame), at);
}

TEST(ALink, AddsItsDelay) {
  LinkProfile profile;
  profile.delay_ms = 12.5;
  Link link{profile, kSeed};
  EXPECT_EQ(link.departure(7, kFrame), 7 + 12'500'000);
}

TEST(ALink, SendsAndDropsLikeAByteQueueThatIsSentAtAConstantRate) {
  LinkProfile profile;
  profile.rate_mbit = 10;
  profile.queue_bytes = 20'000;
  Link link{profile, kSeed};
  std::mt19937 random{kSeed};
  // The oracle stores the frames, and sends each frame after the frames before it.
  struct QueuedFrame {
    double sent_ns;
    std::size_t bytes;
  };
  std::deque<QueuedFrame> queue;
  std::int64_t now = 0;
  int dropped = 0, sent = 0;
  for (int i = 0; i < 20'000; ++i) {
    now += std::uniform_int_distribution<int>{0, 1'100'000}(random);
    const std::size_t bytes = std::uniform_int_distribution<std::size_t>{60, 1514}(random);
    while (!queue.empty() && queue.front().sent_ns <= static_cast<double>(now)) queue.pop_front();
    double queued_bytes = 0;
    for (const QueuedFrame& frame : queue) queued_bytes += static_cast<double>(frame.bytes);
    if (!queue.empty()) {  // the rest of the frame in transmission
      const double unsent =
          std::min(static_cast<double>(queue.front().bytes), (queue.front().sent_ns - static_cast<double>(now)) / 800);
      queued_bytes += unsent - static_cast<double>(queue.front().bytes);
    }
    const double free_bytes = profile.queue_bytes - queued_bytes - static_cast<double>(bytes);
    const auto departure = link.departure(now, bytes);
    if (std::abs(free_bytes) > 1) {  // 1 byte of rounding
      ASSERT_EQ(departure.has_value(), free_bytes > 0) << "frame " << i << ", seed " << kSeed;
    }
    if (!departure) {
      ++dropped;
      continue;
    }
    const double start = queue.empty() ? static_cast<double>(now) : queue.back().sent_ns;
    queue.push_back({start + static_cast<double>(bytes) * 800, bytes});
    ASSERT_NEAR(static_cast<double>(*departure), queue.back().sent_ns, 10 + i)
        << "frame " << i;  // 0.5 ns of rounding for each frame
    ++sent;
  }
  EXPECT_GT(dropped, 100);
  EXPECT_GT(sent, 1000);
  EXPECT_EQ(link.counts().dropped, static_cast<std::uint64_t>(dropped));
}

TEST(ALink, UsesANewProfileForLaterFramesAndKeepsTheirOrder) {
  LinkProfile slow, fast;
  slow.delay_ms = 50;
  fast.delay_ms = 1;
  Link link{slow, kSeed};
  EXPECT_EQ(link.departure(0, kFrame), 50 * kMs);
  link.set_profile(fast);
  EXPECT_EQ(link.departure(10 * kMs, kFrame), 50 * kMs) << "not before the earlier frame";
  EXPECT_EQ(link.departure(60 * kMs, kFrame), 61 * kMs);
}

TEST(ALink, KeepsTheBytesOfItsQueueWhenTheRateChanges) {
  LinkProfile slow, fast;
  slow.rate_mbit = 0.1;  // 80 ms for a frame
  fast.rate_mbit = 20;   // 0.4 ms for a frame
  Link link{slow, kSeed};
  constexpr int kQueued = 125;  // 10 s at the slow rate
  for (int i = 0; i < kQueued; ++i) ASSERT_TRUE(link.departure(0, kFrame));
  link.set_profile(fast);
  EXPECT_EQ(link.departure(0, kFrame), kQueued * 80 * kMs) << "not before the earlier frame";
  constexpr int kLeft = 174;  // of the queue of 300 kB
  for (int i = 0; i < kLeft; ++i) EXPECT_TRUE(link.departure(0, kFrame)) << i;
  EXPECT_FALSE(link.departure(0, kFrame)) << "the queue is full";
  for (int i = 0; i < 100; ++i) EXPECT_TRUE(link.departure(120 * kMs, kFrame)) << "the queue is empty again, " << i;
  link.set_profile(slow);
  EXPECT_EQ(link.departure(15'000 * kMs, kFrame), 15'080 * kMs) << "the queue has emptied before the change";
}

TEST(ALink, HasNoQueueAfterTheLimitOfItsRateIsRemoved) {
  LinkProfile slow;
  slow.rate_mbit = 0.1;
  Link link{slow, kSeed};
  for (int i = 0; i < 125; ++i) (void)link.departure(0, kFrame);
  link.set_profile({});
  EXPECT_EQ(link.departure(kMs, kFrame), 10'000 * kMs);
  link.set_profile(slow);
  EXPECT_EQ(link.departure(10'000 * kMs, kFrame), 10'080 * kMs);
}

TEST(SmoothJitter, StaysSmallAfterTheLimitOfTheRateIsRemoved) {
  LinkProfile slow;
  slow.delay_ms = 100;
  slow.jitter_ms = 25;
  LinkProfile unlimited = slow;
  slow.rate_mbit = 0.1;
  for (std::uint64_t seed = kSeed; seed < kSeed + 20; ++seed) {
    Link link{slow, seed};
    std::int64_t last_departure = 0;
    for (int i = 0; i < 12; ++i) last_departure = link.departure(0, kFrame).value_or(0);  // 0.96 s
    link.set_profile(unlimited);
    for (int i = 1; i <= 100; ++i) {
      const auto departure = link.departure(i * kMs, kFrame);
      ASSERT_TRUE(departure);
      ASSERT_LE(*departure, last_departure + 1000 * kMs) << "frame " << i << ", seed " << seed;
    }
  }
}

TEST(ALink, LosesTheShareOfItsProfile) {
  LinkProfile profile;
  profile.loss = 0.02;
  Link link{profile, kSeed};
  constexpr int kCount = 200'000;
  for (int i = 0; i < kCount; ++i) (void)link.departure(i, kFrame);
  const double sd = std::sqrt(kCount * 0.02 * 0.98);
  EXPECT_NEAR(static_cast<double>(link.counts().lost), kCount * 0.02, 5 * sd);
}

TEST(ALink, RepeatsTheShareOfItsProfileAndLosesTheSameFramesAsWithoutRepeats) {
  LinkProfile profile;
  profile.loss = 0.2;
  Link once{profile, kSeed};
  profile.repeat = 0.1;
  Link link{profile, kSeed};
  constexpr int kCount = 200'000;
  int arrived = 0, repeated = 0;
  for (int i = 0; i < kCount; ++i) {
    const bool arrives = link.departure(i, kFrame).has_value();
    ASSERT_EQ(arrives, once.departure(i, kFrame).has_value());
    arrived += arrives ? 1 : 0;
    repeated += arrives && link.is_repeated() ? 1 : 0;
    EXPECT_FALSE(once.is_repeated());
  }
  EXPECT_NEAR(repeated, arrived * 0.1, 5 * std::sqrt(arrived * 0.1 * 0.9));
  EXPECT_EQ(link.counts().repeated, static_cast<std::uint64_t>(repeated));
}

TEST(ALink, LosesBurstsOfGeometricallyDistributedLengths) {
  LinkProfile profile;
  profile.burst_start = 0.01;
  profile.burst_end = 0.25;
  Link link{profile, kSeed};
  constexpr int kCount = 400'000;
  std::vector<int> lengths;
  int length = 0;
  for (int i = 0; i < kCount; ++i) {
    if (!link.departure(i, kFrame)) {
      ++length;
    } else if (length > 0) {
      lengths.push_back(length);
      length = 0;
    }
  }
  const auto bursts = static_cast<double>(lengths.size());
  // On average, one burst begins every 1 / burst_start + 1 / burst_end frames.
  EXPECT_NEAR(bursts, kCount / (1 / 0.01 + 1 / 0.25), 5 * std::sqrt(bursts));
  for (int min = 1; min <= 10; ++min) {
    const auto longer =
        static_cast<double>(std::count_if(lengths.begin(), lengths.end(), [&](int l) { return l >= min; }));
    const double expected = std::pow(0.75, min - 1);
    EXPECT_NEAR(longer / bursts, expected, 5 * std::sqrt(expected * (1 - expected) / bursts) + 1e-9) << min;
  }
  EXPECT_NEAR(static_cast<double>(link.counts().lost) / kCount, profile.mean_loss(), 0.003);
}

TEST(ALink, LosesTheSameFramesForAnyDelayAndTiming) {
  LinkProfile profile = parse_link("P7").a_to_b;
  profile.rate_mbit = 0;
  Link slow{profile, kSeed};
  profile.delay_ms = 1;
  profile.jitter_ms = 0.5;
  profile.reorder = true;
  Link fast{profile, kSeed};
  for (int i = 0; i < 10'000; ++i)
    ASSERT_EQ(slow.departure(i * kMs, kFrame).has_value(), fast.departure(i * i, kFrame).has_value()) << i;
}

TEST(ALink, LosesTheSameFramesWhateverItsQueueDrops) {
  LinkProfile profile = parse_link("P7").a_to_b;
  profile.rate_mbit = 0;
  Link unlimited{profile, kSeed};
  profile.rate_mbit = 8;  // 1 ms for a frame
  profile.queue_bytes = 2000;
  Link limited{profile, kSeed};
  std::uint64_t dropped = 0;
  for (int i = 0; i < 10'000; ++i) {
    const std::int64_t arrival = i * (kMs * 9 / 10);
    const bool arrives = unlimited.departure(arrival, kFrame).has_value();
    const bool arrives_limited = limited.departure(arrival, kFrame).has_value();
    if (limited.counts().dropped == dropped) {
      ASSERT_EQ(arrives_limited, arrives) << "frame " << i << ", seed " << kSeed;
    }
    dropped = limited.counts().dropped;
  }
  EXPECT_GT(dropped, 100u);
}

TEST(ReorderingJitter, OfAFrameDoesNotDependOnTheLossOfEarlierFrames) {
  LinkProfile profile;
  profile.delay_ms = 20;
  profile.jitter_ms = 3;
  profile.reorder = true;
  Link lossless{profile, kSeed};
  profile.loss = 0.5;
  Link lossy{profile, kSeed};
  int lost = 0;
  for (int i = 0; i < 1000; ++i) {
    const auto expected = lossless.departure(i * kMs, kFrame);
    const auto departure = lossy.departure(i * kMs, kFrame);
    if (!departure)
      ++lost;
    else
      ASSERT_EQ(departure, expected) << "frame " << i << ", seed " << kSeed;
  }
  EXPECT_GT(lost, 100);
}

TEST(ALink, DependsOnlyOnSeedAndArrivals) {
  const LinkProfile profile = parse_link("P3").a_to_b;
  Link link{profile, 1}, same{profile, 1}, other{profile, 2};
  int different = 0;
  for (int i = 0; i < 1000; ++i) {
    const auto departure = link.departure(i * kMs, kFrame);
    ASSERT_EQ(departure, same.departure(i * kMs, kFrame));
    if (departure != other.departure(i * kMs, kFrame)) ++different;
  }
  EXPECT_GT(different, 900);
}

TEST(ReorderingJitter, IsNormalAndIndependentAndLetsFramesOvertake) {
  LinkProfile profile;
  profile.delay_ms = 20;
  profile.jitter_ms = 3;
  profile.reorder = true;
  Link link{profile, kSeed};
  constexpr int kCount = 20'000;
  const std::vector<double> delays_ms = delays(link, kCount, kMs);
  EXPECT_LT(distance_from_normal(delays_ms, 20, 3),
            1.95 / std::sqrt(kCount));  // Kolmogorov test with significance 0.001
  double products = 0;
  int overtaken = 0;
  for (int i = 1; i < kCount; ++i) {
    products += (delays_ms[i] - 20) * (delays_ms[i - 1] - 20);
    if (delays_ms[i] + 1 < delays_ms[i - 1]) ++overtaken;
  }
  EXPECT_NEAR(products / kCount / 9, 0, 5 / std::sqrt(kCount));
  // A frame overtakes the frame that is 1 ms ahead if its delay is more than 1 ms smaller. The difference of two delays
  // has a standard deviation of 3 sqrt(2) ms.
  const double expected = 0.5 * std::erfc(1 / (3 * std::sqrt(2.0)) / std::sqrt(2.0));
  EXPECT_NEAR(overtaken / static_cast<double>(kCount), expected, 0.02);
}

TEST(SmoothJitter, KeepsOrderAndHasTheStandardDeviationOfItsProfile) {
  LinkProfile profile;
  profile.delay_ms = 100;
  profile.jitter_ms = 25;
  Link link{profile, kSeed};
  std::int64_t last_departure = 0;
  std::vector<double> independent_delays;  // one delay per 500 ms; the correlation time is 100 ms
  for (int i = 0; i < 2'000'000; ++i) {
    const std::int64_t arrival = i * kMs;
    const auto departure = link.departure(arrival, kFrame);
    ASSERT_GE(*departure, last_departure);
    last_departure = *departure;
    if (i % 500 == 0) independent_delays.push_back(static_cast<double>(*departure - arrival) * 1e-6);
  }
  EXPECT_LT(distance_from_normal(independent_delays, 100, 25),
            1.95 / std::sqrt(static_cast<double>(independent_delays.size())));
}

TEST(SmoothJitter, HasTheCorrelationOfItsTimeConstant) {
  LinkProfile profile;
  profile.delay_ms = 100;
  profile.jitter_ms = 10;
  Link link{profile, kSeed};
  const std::vector<double> delays_ms = delays(link, 400'000, 10 * kMs);
  const double average = mean(delays_ms), sd = standard_deviation(delays_ms);
  EXPECT_NEAR(sd, 10, 0.5);
  for (const int lag : {1, 5, 10, 30}) {  // in frames; one arrives every 10 ms
    double sum = 0;
    for (std::size_t i = static_cast<std::size_t>(lag); i < delays_ms.size(); ++i)
      sum += (delays_ms[i] - average) * (delays_ms[i - static_cast<std::size_t>(lag)] - average);
    const double correlation = sum / static_cast<double>(delays_ms.size()) / (sd * sd);
    const double scaled_lag = lag * 10 / kJitterCorrelationMs;
    EXPECT_NEAR(correlation, (1 + scaled_lag) * std::exp(-scaled_lag), 0.03) << lag * 10 << " ms";  // Matern, nu = 3/2
  }
}

TEST(SmoothJitter, HasTheSameStandardDeviationAtAnySamplingRate) {
  LinkProfile profile;
  profile.delay_ms = 100;
  profile.jitter_ms = 10;
  for (const std::int64_t period : {kMs / 100, kMs, 100 * kMs}) {
    double sum = 0;
    constexpr int kIntervals = 300;
    for (int run = 0; run < kIntervals; ++run) {
      Link link{profile, kSeed + static_cast<std::uint64_t>(run)};
      const double jitter_ms = delays(link, static_cast<int>(100 * kMs / period) + 1, period).back() - 100;
      sum += jitter_ms * jitter_ms;
    }
    EXPECT_NEAR(std::sqrt(sum / kIntervals), 10, 5 * 10 / std::sqrt(2.0 * kIntervals)) << period << " ns";
  }
}

TEST(EveryNamedLink, IsValidAndUnique) {
  std::vector<std::string> names;
  for (const NamedLink& link : kNamedLinks) {
    EXPECT_NO_THROW(check(parse_link(link.name))) << link.name;
    names.push_back(link.name);
  }
  EXPECT_THAT(names, ElementsAre("veth", "P0", "P1", "P2", "P3", "P4", "P5", "P6", "P7", "P8"));
}

TEST(EveryNamedLink, LosesTheShareOfItsStudy) {
  const std::vector<double> expected{0, 0, 0, 1e-4, 1e-3, 5e-3, 1e-2, 1e-2, 5e-2, 2e-2};
  for (std::size_t i = 0; i < expected.size(); ++i)
    EXPECT_NEAR(kNamedLinks[i].each_direction.mean_loss(), expected[i], 0.005 * expected[i]) << kNamedLinks[i].name;
}

TEST(AnAsymmetricLink, HasSevenTenthsOfTheRoundTripInTheForwardDirection) {
  const LinkSettings link = parse_link("P5a");
  EXPECT_DOUBLE_EQ(link.a_to_b.delay_ms + link.b_to_a.delay_ms, 80);
  EXPECT_DOUBLE_EQ(link.a_to_b.delay_ms, 56);
  EXPECT_DOUBLE_EQ(link.a_to_b.jitter_ms, 7);
}

TEST(LinkText, ChangesTheNamedLinkInBothDirections) {
  const LinkSettings link = parse_link("P4a:loss=2.5:burst=0.02/0.5:rate=20:queue=9000:jitter=1:reorder");
  for (const LinkProfile* direction : {&link.a_to_b, &link.b_to_a}) {
    EXPECT_DOUBLE_EQ(direction->loss, 0.025);
    EXPECT_DOUBLE_EQ(direction->burst_start, 0.02);
    EXPECT_DOUBLE_EQ(direction->burst_end, 0.5);
    EXPECT_DOUBLE_EQ(direction->rate_mbit, 20);
    EXPECT_EQ(direction->queue_bytes, 9000u);
    EXPECT_DOUBLE_EQ(direction->jitter_ms, 1);
    EXPECT_TRUE(direction->reorder);
  }
  EXPECT_DOUBLE_EQ(link.a_to_b.delay_ms, 21);
  EXPECT_DOUBLE_EQ(link.b_to_a.delay_ms, 9);
}

std::string parse_error(const std::string& text) {
  try {
    (void)parse_link(text);
  } catch (const LinkError& error) {
    return error.what();
  }
  return "";
}

TEST(LinkText, IsRefusedWithTheFoundAndTheExpectedSetting) {
  EXPECT_THAT(parse_error("P0:dealy=3"), HasSubstr("no setting 'dealy=3'; expected delay=MS, jitter=MS"));
  EXPECT_THAT(parse_error("P0:delay=ten"), HasSubstr("delay is 'ten'; expected a number"));
  EXPECT_THAT(parse_error("P0:delay"), HasSubstr("delay is ''; expected a number"));
  EXPECT_THAT(parse_error("P0:burst=0.1"), HasSubstr("no setting 'burst=0.1'"));
  EXPECT_THAT(parse_error("P0:loss=101"), HasSubstr("loss is 1.01; expected 0 to 1"));
  EXPECT_THAT(parse_error("P0:rate=5Mbit"), HasSubstr("rate is '5Mbit'"));
  EXPECT_THAT(parse_error("P0:"), testing::IsEmpty());
}

template <class Change>
std::string check_error(const char* name, Change change) {
  LinkSettings link = parse_link(name);
  change(link.a_to_b);
  try {
    check(link);
  } catch (const LinkError& error) {
    return error.what();
  }
  return "";
}

TEST(AnInvalidLink, IsRefusedWithTheFoundAndTheExpectedValue) {
  EXPECT_THAT(check_error("P2", [](LinkProfile& direction) { direction.loss = 1.5; }),
              HasSubstr("link P2: loss is 1.5; expected 0 to 1"));
  EXPECT_THAT(check_error("P2", [](LinkProfile& direction) { direction.jitter_ms = 6; }),
              HasSubstr("jitter, ms, is 6; expected 0 to 5, the delay"));
  EXPECT_THAT(check_error("P2", [](LinkProfile& direction) { direction.burst_end = 0; }),
              HasSubstr("end of bursts is 0"));
  EXPECT_THAT(check_error("P2", [](LinkProfile& direction) { direction.queue_bytes = 100; }),
              HasSubstr("queue, bytes, is 100"));
  EXPECT_THAT(check_error("P2", [](LinkProfile& direction) { direction.delay_ms = NAN; }), HasSubstr("delay"));
  EXPECT_THAT(check_error("P2", [](LinkProfile& direction) { direction.rate_mbit = 1e-10; }),
              HasSubstr("rate, Mbit/s, is 1e-10; expected 0.001 to 100000, or 0 for no limit"));
  EXPECT_THAT(check_error("veth", [](LinkProfile& direction) { direction.delay_ms = 1; }), HasSubstr("use P0"));
  EXPECT_THROW((void)parse_link("P9"), LinkError);
  EXPECT_THROW((void)parse_link("vetha"), LinkError);
}

}  // namespace
}  // namespace tactus::netem
