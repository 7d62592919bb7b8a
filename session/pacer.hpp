/// Congestion control of the chunks to one HRTC: limits the bytes in flight and spreads them in time, by their delay.
///
/// Each demand reports the min one-way delay of the chunks since the previous demand, as a difference of the clocks of
/// host and HRTC. The base delay is measured while few bytes are sent. The one-way delay minus the base delay is the
/// queueing delay, in which the clock offset cancels. The window adapts so that the queueing delay stays near a target
/// of about a millisecond, or more on long round trips. So the pacer fills a link of any rate, and delays probe states
/// in the same queue only a little. A few losses do not shrink the window, because a lossy link need not be full.
/// Chunks are spread evenly over the round trip.
///
/// Source: LEDBAT, RFC 6817. Differences: the target; the window changes in proportion to the reported bytes, and only
/// while it limits the sender; it shrinks for some round trips every few seconds, so that the base delay can be
/// measured on a full link (LEDBAT++). The base delay is a mean, not the min. On links with jitter most delays are far
/// above the min of some seconds; with the min, this difference would count as queueing delay and close the window.
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
  /// Reports that there is nothing to send.
  void set_idle() noexcept { paced_ = false; }

  /// The report of a demand about chunks that were in flight.
  struct Feedback {
    std::uint32_t arrived_bytes = 0, lost_bytes = 0;
    std::int64_t round_trip_ns = 0;           ///< time since the sending of the oldest chunk that arrived
    std::optional<std::uint32_t> one_way_us;  ///< Demand::one_way_us
  };
  void on_feedback(const Feedback& feedback, std::int64_t now_ns);
  /// Removes bytes in flight for which no feedback will come.
  void remove_in_flight(std::uint32_t bytes) noexcept { in_flight_ -= bytes; }

  [[nodiscard]] std::uint32_t in_flight() const noexcept { return in_flight_; }
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
  bool paced_ = false;              // only the pace delayed the last chunk
  // One-way delays relative to the first, us: the min of this span and of the span before it.
  std::optional<std::uint32_t> first_us_;
  std::int32_t min_us_[2];
  std::int64_t span_ns_ = 0;
  std::int64_t queueing_ns_ = 0;
  std::int64_t empty_ns_ = 0;        // when the queue was last measured to be empty
  std::int64_t drain_until_ns_ = 0;  // until then the window is reduced to `drain_share_`
  double drain_share_ = 1;
  // Base delay, us: mean over the last second in which this stream sent too little to cause a queue.
  std::optional<double> base_delay_us_;
  std::int64_t measured_ns_ = 0;
  std::int64_t base_delay_excess_ns_ = 0;  // base delay above the min
  std::int64_t loaded_until_ns_ = 0;
  double best_ = 0;  // bytes/ns, largest arrival rate of the last round trips
  // The current round trip: begin, and bytes reported since.
  std::int64_t round_ns_ = 0;
  std::uint64_t round_arrived_ = 0, round_lost_ = 0;

 public:
  Pacer() noexcept;
};

}  // namespace tactus::session
