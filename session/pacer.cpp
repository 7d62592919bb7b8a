#include "session/pacer.hpp"

#include <algorithm>

#include "session/messages.hpp"
#include "session/units.hpp"

namespace tactus::session {
namespace {

constexpr double kFirstWindow = 10 * kMaxPayload;  // RFC 6928
constexpr double kMinWindow = 2 * kMaxPayload;
constexpr double kMaxWindow = 16e6;
constexpr std::int64_t kInitialRoundTrip = 10 * kMs;
constexpr std::int64_t kMinRoundTrip = kMs;

// Target queueing delay: the sum of a constant, a share of the round trip, and half the time to send a chunk.
constexpr std::int64_t kTarget = kMs / 4;
constexpr std::int64_t kTargetDivisor = 8;  // the share is the round trip divided by this
constexpr double kMaxHalfChunkTime = 8e6;   // ns
// Max growth of the window per round trip after the start, as a share of the window. It is small, because a late demand
// still reports an empty queue. Below half of the largest measured rate the growth is faster.
constexpr double kGain = 1.0 / 16, kRecoveryGain = 1.0 / 8;
constexpr double kMaxDecrease = 8;  // max decrease of the window, as a multiple of kGain

constexpr double kPaceStarting = 2, kPace = 1.2;    // windows per round trip
constexpr std::int64_t kCatchUp = 4 * kMs;          // max time lost to pacing that the sender may make up for
constexpr std::int64_t kSpan = 10'000 * kMs;        // the min of the one-way delays is over one to two such spans
constexpr std::int64_t kDrainEvery = 2'000 * kMs;   // max time without a measurement of an empty queue
constexpr std::int64_t kDrainEveryRoundTrips = 40;  // the same in round trips, used if longer
constexpr double kDrainShare = 0.5;                 // share of the window that remains for one round trip
// A deep drain measures the base delay: one round trip until fewer bytes are in flight, one until the delay falls, and
// one to measure.
constexpr std::int64_t kDeepDrainRoundTrips = 3;
constexpr double kDeepDrainShare = 0.25;

constexpr std::int64_t kBaseDelayOver = 1'000 * kMs;  // time over which the base delay is averaged
/// A base delay can be measured with a queue. It is therefore limited to the min plus the round trip divided by this.
constexpr std::int64_t kMaxBaseDelayDivisor = 2;
constexpr double kMaxRateDecay = 0.99;                   // factor by which the largest rate decays per round trip
constexpr std::uint32_t kMaxLossSeen = 8 * kMaxPayload;  // loss in a round trip that never halves the window, bytes

}  // namespace

Pacer::Pacer() noexcept : window_{kFirstWindow}, min_us_{0, 0} {}

double Pacer::pace() const noexcept {
  const std::int64_t round_trip = round_trip_ns_ == 0 ? kInitialRoundTrip : std::max(round_trip_ns_, kMinRoundTrip);
  return (starting_ ? kPaceStarting : kPace) * window_ / static_cast<double>(round_trip);
}

std::int64_t Pacer::target_ns() const noexcept {
  const double chunk = std::min(static_cast<double>(kMaxPayload * round_trip_ns_) / window_ / 2, kMaxHalfChunkTime);
  return kTarget + round_trip_ns_ / kTargetDivisor + static_cast<std::int64_t>(chunk);
}

bool Pacer::may_send(std::uint32_t bytes, std::int64_t now_ns) {
  // Only time lost to pacing is made up for, not time without data or with a full window.
  if (!paced_) next_ns_ = std::max(next_ns_, now_ns);
  const double window = now_ns < drain_until_ns_ ? drain_share_ * window_ : window_;
  if (in_flight_ != 0 && in_flight_ + bytes > window) {
    was_blocked_ = true;
    paced_ = false;
    return false;
  }
  if (now_ns >= next_ns_) return true;
  was_blocked_ = paced_ = true;
  return false;
}

void Pacer::on_sent(std::uint32_t bytes, std::int64_t now_ns) {
  in_flight_ += bytes;
  next_ns_ = std::max(next_ns_, now_ns - kCatchUp) + static_cast<std::int64_t>(bytes / pace());
}

void Pacer::record_one_way(std::uint32_t one_way_us, std::int64_t now_ns) {
  if (!first_us_) {
    first_us_ = one_way_us;
    span_ns_ = empty_ns_ = now_ns;
  }
  const auto us = static_cast<std::int32_t>(one_way_us - *first_us_);
  if (now_ns - span_ns_ >= kSpan) {
    min_us_[1] = std::exchange(min_us_[0], us);
    span_ns_ = now_ns;
  }
  min_us_[0] = std::min(min_us_[0], us);
  const std::int32_t min = std::min(min_us_[0], min_us_[1]);
  if (now_ns >= loaded_until_ns_) {
    const double share = std::min(1.0, static_cast<double>(now_ns - measured_ns_) / kBaseDelayOver);
    base_delay_us_ = base_delay_us_ ? *base_delay_us_ + share * (us - *base_delay_us_) : us;
  }
  measured_ns_ = now_ns;
  double base_us = min;
  if (base_delay_us_) {
    const double max = static_cast<double>(round_trip_ns_ / kMaxBaseDelayDivisor) * 1e-3;
    base_us = std::clamp(*base_delay_us_, base_us, base_us + max);
    base_delay_excess_ns_ = static_cast<std::int64_t>((base_us - min) * 1e3);
  }
  queueing_ns_ = static_cast<std::int64_t>((us - base_us) * 1e3);
  if ((us - min) * std::int64_t{1000} < target_ns() / 4) empty_ns_ = now_ns;
}

/// Measures the arrival rate over a round trip, and halves the window if most chunks were lost.
void Pacer::record_round(const Feedback& feedback, std::int64_t now_ns) {
  round_arrived_ += feedback.arrived_bytes;
  round_lost_ += feedback.lost_bytes;
  const std::int64_t duration_ns = now_ns - round_ns_;
  if (duration_ns < round_trip_ns_) return;
  // No link loses so many chunks by itself. A queue that is too short to cause a measurable delay has overflowed.
  if (round_lost_ > std::max<std::uint64_t>(round_arrived_, kMaxLossSeen)) window_ = std::max(window_ / 2, kMinWindow);
  max_arrival_rate_ = std::max(kMaxRateDecay * max_arrival_rate_,
                               static_cast<double>(round_arrived_) / static_cast<double>(duration_ns));
  round_ns_ = now_ns;
  round_arrived_ = round_lost_ = 0;
}

void Pacer::on_feedback(const Feedback& feedback, std::int64_t now_ns) {
  // If the bytes in flight are far below the window, the sender had no more data, so this stream did not cause a queue.
  // Because of the pacing, they may be slightly below the window even if the sender had data.
  const bool may_cause_queue = in_flight_ > window_ / 3;
  const bool was_limited = std::exchange(was_blocked_, false) && may_cause_queue;
  if (in_flight_ > max_arrival_rate_ * static_cast<double>(round_trip_ns_) / 2)
    loaded_until_ns_ = now_ns + 2 * round_trip_ns_;
  in_flight_ -= feedback.arrived_bytes + feedback.lost_bytes;
  if (feedback.arrived_bytes == 0) return;
  constexpr std::int64_t kSmoothing = 8;
  round_trip_ns_ +=
      round_trip_ns_ == 0 ? feedback.round_trip_ns : (feedback.round_trip_ns - round_trip_ns_) / kSmoothing;
  record_round(feedback, now_ns);
  if (!feedback.one_way_us) return;
  record_one_way(*feedback.one_way_us, now_ns);

  if (now_ns < drain_until_ns_) return;
  const std::int64_t drain_every_ns =
      base_delay_us_ ? std::max(kDrainEvery, kDrainEveryRoundTrips * round_trip_ns_) : kDrainEvery;
  if (now_ns - empty_ns_ >= drain_every_ns) {
    const bool deep = !base_delay_us_ || base_delay_excess_ns_ > target_ns() / 4;
    drain_share_ = deep ? kDeepDrainShare : kDrainShare;
    drain_until_ns_ = now_ns + (deep ? kDeepDrainRoundTrips : 1) * round_trip_ns_;
    empty_ns_ = drain_until_ns_;
  }
  const auto target = static_cast<double>(target_ns());
  const double deviation = std::clamp((target - static_cast<double>(queueing_ns_)) / target, -kMaxDecrease, 1.0);
  starting_ = starting_ && deviation > 0.25;
  if (deviation > 0 ? !was_limited : !may_cause_queue) return;
  const bool is_below_reached_rate =
      deviation > 0 && window_ < max_arrival_rate_ * static_cast<double>(round_trip_ns_) / 2;
  const double gain = starting_ ? 1 : (is_below_reached_rate ? kRecoveryGain : kGain) * deviation;
  window_ = std::clamp(window_ + gain * feedback.arrived_bytes, kMinWindow, kMaxWindow);
}

}  // namespace tactus::session
