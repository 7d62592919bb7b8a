/// Finds out whether a link carries the full-rate states of a remote probe.
///
/// A full-rate state misses its purpose if it is lost, or if it arrives more than 200 ms later than the fastest one. If
/// this happens to more than 40 % of the states in each of three successive intervals of 0.3 s, the link is too slow. A
/// link that loses 30 % of the packets at random passes. While states fill a link, heartbeats and mesh records are lost
/// too.
///
/// No clock and no DDS. One thread at a time. Does not allocate.
#pragma once

#include <cstdint>

namespace tactus::session {

class FullRateCheck {
 public:
  /// Counts a state that arrived. `number`: its sequence number, 1 more than that of the state before.
  /// `transit_ns`: time from its cycle to its arrival, in session time. `now_ns`: arrival, any clock that does not jump.
  void on_state(std::uint32_t number, std::int64_t transit_ns, std::int64_t now_ns) noexcept;

  /// Whether states have arrived lately.
  [[nodiscard]] bool is_active(std::int64_t now_ns) const noexcept { return now_ns - last_ns_ <= kMaxGapNs; }
  [[nodiscard]] bool is_too_slow(std::int64_t now_ns) const noexcept {
    return is_active(now_ns) && bad_intervals_ >= kBadIntervals;
  }
  /// The share of the states that missed their purpose, in the last interval.
  [[nodiscard]] double missed_share() const noexcept { return missed_share_; }

 private:
  static constexpr std::int64_t kMaxGapNs = 500'000'000;  // a longer gap is an interruption, and the check starts anew
  static constexpr int kBadIntervals = 3;

  void restart(std::uint32_t number, std::int64_t now_ns) noexcept;

  std::int64_t last_ns_ = INT64_MIN / 2;          // newest arrival
  std::int64_t fastest_ns_ = INT64_MAX;           // shortest transit
  std::int64_t begin_ns_ = 0;                     // of the current interval
  std::uint32_t begin_number_ = 0, on_time_ = 0;  // first number of this interval, and states on time in it
  int bad_intervals_ = 0;                         // successive ones with too many missed states
  double missed_share_ = 0;
};

}  // namespace tactus::session
