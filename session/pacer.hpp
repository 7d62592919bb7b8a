/// Congestion control of the chunks to one HRTC. The delay of earlier chunks determines the window: the max number of
/// bytes in flight. Chunks are spread evenly over the round trip.
///
/// Each demand reports the min one-way delay of the chunks since the previous demand: their arrival time by the clock
/// of the HRTC, minus their sending time by the clock of the host. The base delay is the one-way delay without a queue,
/// measured while few bytes are in flight. The one-way delay minus the base delay is the queueing delay. Both delays
/// contain the clock offset, so it cancels. The window adapts so that the queueing delay stays near a target of about a
/// millisecond; on long round trips the target is higher. So the pacer fills a link of any rate, and delays probe
/// states in the same queue only a little. A few losses do not shrink the window, because some links lose chunks
/// without being full.
///
/// Source: LEDBAT, RFC 6817. Differences:
/// - The target is lower, and depends on the round trip.
/// - The window changes in proportion to the bytes that arrived. It grows only while window or pace limits the sender,
///   and queueing delay shrinks it only while more than a third of it is in flight.
/// - If the queue has not been empty for a few seconds, the window shrinks for one or more round trips (a drain), so
///   that the base delay can be measured on a full link (LEDBAT++).
/// - The base delay is a mean, not a min. On links with jitter most delays are far above their min. With a min as base
///   delay, the jitter would count as queueing delay, and the window would shrink.
///
/// No clock: times are nanoseconds of the host's monotonic clock. One thread at a time.
#pragma once

#include <cstdint>
#include <optional>

namespace tactus::session {

class Pacer {
 public:
  /// Whether a chunk of this size may be sent now.
  [[nodiscard]] bool may_send(std::uint32_t bytes, std::int64_t now_ns);
  /// Time from which the pace allows the next chunk.
  [[nodiscard]] std::int64_t next_ns() const noexcept { return next_ns_; }
  /// Reports a chunk that was sent.
  void on_sent(std::uint32_t bytes, std::int64_t now_ns);
  /// Reports that there is nothing to send, so that the pacer does not send faster later to make up for this time.
  void set_idle() noexcept { paced_ = false; }

  /// The report of a demand about chunks that were in flight.
  struct Feedback {
    std::uint32_t arrived_bytes = 0, lost_bytes = 0;
    std::int64_t round_trip_ns = 0;           ///< time from sending the oldest of the arrived chunks to this report
    std::optional<std::uint32_t> one_way_us;  ///< Demand::one_way_us
  };
  void on_feedback(const Feedback& feedback, std::int64_t now_ns);
  /// Removes bytes in flight for which no feedback will come.
  void remove_in_flight(std::uint32_t bytes) noexcept { in_flight_ -= bytes; }

  [[nodiscard]] std::uint32_t in_flight() const noexcept { return in_flight_; }
  /// Max bytes in flight, except during a drain.
  [[nodiscard]] double window() const noexcept { return window_; }
  /// Queueing delay of the newest chunks.
  [[nodiscard]] std::int64_t queueing_ns() const noexcept { return queueing_ns_; }

 private:
  [[nodiscard]] double pace() const noexcept;  // bytes/ns
  [[nodiscard]] std::int64_t target_ns() const noexcept;
  void record_round(const Feedback& feedback, std::int64_t now_ns);
  void record_one_way(std::uint32_t one_way_us, std::int64_t now_ns);

  double window_;  // bytes
  std::uint32_t in_flight_ = 0;
  std::int64_t next_ns_ = 0;
  std::int64_t round_trip_ns_ = 0;  // from sending a chunk to its feedback, smoothed; 0 before the first
  bool starting_ = true;            // slow start: the window doubles each round trip
  bool was_blocked_ = false;        // window or pace has delayed a chunk since the last feedback
  bool paced_ = false;              // the pace, not the window or a lack of data, caused the last delay
  // One-way delays relative to the first, us: min of the current span of some seconds, and of the span before it.
  std::optional<std::uint32_t> first_us_;
  std::int32_t min_us_[2];
  std::int64_t span_ns_ = 0;  // begin of the current span
  std::int64_t queueing_ns_ = 0;
  std::int64_t empty_ns_ = 0;        // when the queue was last measured to be empty; after a drain has begun, its end
  std::int64_t drain_until_ns_ = 0;  // end of the drain; until then, the max bytes in flight are drain_share_ * window_
  double drain_share_ = 1;
  // Base delay relative to the first one-way delay, us. It is a mean over about a second of the delays measured while
  // this stream had too few bytes in flight to cause a queue.
  std::optional<double> base_delay_us_;
  std::int64_t measured_ns_ = 0;           // time of the newest one-way delay
  std::int64_t base_delay_excess_ns_ = 0;  // base delay above the min
  std::int64_t loaded_until_ns_ = 0;       // until then, this stream may cause a queue
  double max_arrival_rate_ = 0;            // bytes/ns, in the last round trips
  // The current round trip: begin, and bytes reported since.
  std::int64_t round_ns_ = 0;
  std::uint64_t round_arrived_ = 0, round_lost_ = 0;

 public:
  Pacer() noexcept;
};

}  // namespace tactus::session
