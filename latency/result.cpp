#include "latency/result.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "session/clock.hpp"
#include "session/percentile.hpp"

namespace tactus::latency {
namespace {

constexpr std::size_t kMaxBins = 400;
constexpr std::int64_t kSamplePeriodNs = 97'000;  // divides no usual period of pings, so that the phase varies

/// Maps times of the pinger's clock to the echoer's clock. For each time it uses the estimate that a session clock had
/// at that time.
class EchoerClock {
 public:
  explicit EchoerClock(const Timestamps& timestamps) {
    if (timestamps.shares_clock) return;
    const session::Origin pinger{1, 1, 1, 0}, echoer{1, 2, 1, 0};
    session::ClockSettings settings;
    settings.window = 256;
    session::SessionClock clock{pinger, settings, 0};
    clock.set_reference(echoer.participant, echoer.incarnation, 0);
    for (const Echo& echo : timestamps.echoes) {
      if (echo.reader != 0 || echo.sequence >= timestamps.pings.size()) continue;
      session::ClockSample sample = clock.request(timestamps.pings[echo.sequence].sent_ns);
      sample.origin = echoer;
      sample.peer = pinger.participant;
      sample.answer = true;
      sample.t1_ns = echo.received_ns;
      sample.t2_ns = echo.echoed_ns;
      if (clock.on_answer(sample, echo.arrived_ns)) maps_.push_back(clock.map());
    }
    shares_clock_ = false;
  }

  /// Returns the echoer's time at the pinger's time `local_ns`. Raises bound_us to the error bound of the result.
  std::int64_t at(std::int64_t local_ns) {
    if (shares_clock_) return local_ns;
    if (maps_.empty()) {
      bound_ns_ = session::kClockUnknown;
      return local_ns;
    }
    auto next = std::upper_bound(maps_.begin(), maps_.end(), local_ns,
                                 [](std::int64_t time, const session::ClockMap& map) { return time < map.local_ns; });
    const session::ClockMap& map = next == maps_.begin() ? *next : *std::prev(next);
    bound_ns_ = std::max(bound_ns_, map.error_bound(std::max(local_ns, map.local_ns)));
    return map.session_time(local_ns);
  }
  [[nodiscard]] double bound_us() const noexcept { return static_cast<double>(bound_ns_) * 1e-3; }

 private:
  bool shares_clock_ = true;
  std::vector<session::ClockMap> maps_;
  std::int64_t bound_ns_ = 0;
};

}  // namespace

const std::vector<double>& quantile_shares() {
  static const std::vector<double> shares = [] {
    std::vector<double> all;
    for (int i = 0; i <= 80; ++i) all.push_back(1 - std::pow(10.0, -i / 20.0));
    return all;
  }();
  return shares;
}

std::uint32_t warm_up(const TestCase& test) noexcept {
  constexpr double kSeconds = 0.3;
  return std::min(static_cast<std::uint32_t>(kSeconds * test.rate_hz), test.ticks() / 5);
}

Result evaluate(const Timestamps& timestamps) {
  Result result;
  result.test = timestamps.test;
  result.notes = timestamps.notes;
  result.load_mbyte_per_s = timestamps.load_bytes_per_s * 1e-6;
  const auto all = static_cast<std::uint32_t>(timestamps.pings.size());
  // A coded test has fewer pings than ticks. The warm-up has the same share of the pings as of the ticks.
  const auto first =
      static_cast<std::uint32_t>(std::uint64_t{warm_up(timestamps.test)} * all / timestamps.test.ticks());
  const std::uint32_t evaluated = all - first;
  result.expected = static_cast<std::uint64_t>(evaluated) * timestamps.test.readers;
  if (all > 0) result.evaluated_s = timestamps.test.seconds * evaluated / all;

  std::vector<double> timer;
  for (std::uint32_t i = first; i < all; ++i) {
    const Ping& ping = timestamps.pings[i];
    if (ping.refused || ping.sent_ns == 0) ++result.refused;
    if (ping.waited) timer.push_back(static_cast<double>(ping.sent_ns - ping.intended_ns) * 1e-3);
  }
  result.timer = summarise(timer);

  EchoerClock clock{timestamps};
  std::vector<SequenceTally> tallies(timestamps.test.readers, SequenceTally{evaluated});
  std::vector<InterarrivalJitter> jitters(timestamps.test.readers);
  std::vector<double> age, information_age;
  struct Newest {
    std::int64_t sequence = -1, intended_ns = 0, sampled_ns = 0;  // the echoer's clock
  };
  std::vector<Newest> newest(timestamps.test.readers);
  for (const Arrival& arrival : timestamps.arrivals) {
    if (arrival.sequence < first || arrival.sequence >= all || arrival.reader >= timestamps.test.readers) continue;
    if (!tallies[arrival.reader].add(arrival.sequence - first)) continue;
    const Ping& ping = timestamps.pings[arrival.sequence];
    const std::int64_t intended_ns = clock.at(ping.intended_ns);
    age.push_back(static_cast<double>(arrival.received_ns - intended_ns) * 1e-3);
    Newest& last = newest[arrival.reader];
    if (last.sequence >= 0) {
      for (; last.sampled_ns < arrival.received_ns; last.sampled_ns += kSamplePeriodNs)
        information_age.push_back(static_cast<double>(last.sampled_ns - last.intended_ns) * 1e-3);
    } else {
      last.sampled_ns = arrival.received_ns;
    }
    if (last.sequence < arrival.sequence) last = {arrival.sequence, intended_ns, last.sampled_ns};
    jitters[arrival.reader].add(ping.sent_ns, arrival.received_ns);
  }
  // The age grows until the last ping is due, even if nothing arrives any more.
  const std::int64_t end_ns = evaluated > 0 ? clock.at(timestamps.pings.back().intended_ns) : 0;
  for (Newest& last : newest) {
    const bool has_arrival = last.sequence >= 0;
    if (!has_arrival && evaluated > 0) last.sampled_ns = clock.at(timestamps.pings[first].intended_ns);
    for (; evaluated > 0 && last.sampled_ns <= end_ns; last.sampled_ns += kSamplePeriodNs)
      information_age.push_back(has_arrival ? static_cast<double>(last.sampled_ns - last.intended_ns) * 1e-3
                                            : std::numeric_limits<double>::infinity());
  }
  result.age = summarise(age);
  result.age_of_information = summarise(information_age);
  result.clock_bound_us = clock.bound_us();
  for (const SequenceTally& tally : tallies) {
    result.lost += tally.lost();
    result.reordered += tally.reordered();
    result.duplicates += tally.duplicates();
  }
  for (const InterarrivalJitter& jitter : jitters) result.jitter_us = std::max(result.jitter_us, jitter.us());

  std::vector<double> intended, sent;
  std::vector<SequenceTally> answered(timestamps.test.readers, SequenceTally{evaluated});
  std::vector<std::vector<double>> by_bin(std::min<std::size_t>(kMaxBins, std::max<std::uint32_t>(evaluated, 1)));
  const auto bin_of = [&](std::uint32_t sequence) { return (sequence - first) * by_bin.size() / evaluated; };
  for (const Echo& echo : timestamps.echoes) {
    if (echo.sequence < first || echo.sequence >= all || echo.reader >= timestamps.test.readers) continue;
    if (!answered[echo.reader].add(echo.sequence - first)) continue;
    const Ping& ping = timestamps.pings[echo.sequence];
    intended.push_back(static_cast<double>(echo.arrived_ns - ping.intended_ns) * 0.5e-3);
    sent.push_back(static_cast<double>(echo.arrived_ns - ping.sent_ns) * 0.5e-3);
    by_bin[bin_of(echo.sequence)].push_back(intended.back());
  }
  result.half_round_trip = summarise(intended);
  result.half_round_trip_sent = summarise(sent);
  result.echoes_lost =
      result.expected - result.lost - std::min<std::uint64_t>(result.expected - result.lost, intended.size());
  for (const double share : quantile_shares()) result.curve.push_back(session::percentile(intended, share));
  std::vector<std::uint32_t> pings_of(by_bin.size(), 0);
  for (std::uint32_t i = first; i < all; ++i) ++pings_of[bin_of(i)];
  for (std::size_t i = 0; i < by_bin.size(); ++i) {
    const Summary summary = summarise(by_bin[i]);
    result.bins.push_back(
        {summary.p50, summary.max, pings_of[i] * timestamps.test.readers - static_cast<std::uint32_t>(summary.count)});
  }
  return result;
}

}  // namespace tactus::latency
