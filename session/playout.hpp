/// When a receiver shows a remote probe: late enough that its states have come, and no later.
///
///     state of 10 ms   -----> arrives 15.2        shown at 10 + P
///     state of 20 ms   ------------> arrives 27   shown at 20 + P       P: how long nearly all are under way
///
/// The delay P is how long nearly all states are under way (session/transit.hpp). It rises at once and falls by 1 % of
/// the time passed. So what is shown is a true past, in even time, and how far past is known. Between two states that
/// follow each other by number the first is carried on (`reckon`), which the sender has seen to be right; where one
/// between them was lost, what is shown goes straight from one to the other.
///
/// For one probe. Times are session time; transit is as good as its bounds at both ends, and only its changes matter.
/// One thread at a time. Does not allocate.
/// Source: Ramjee, Kurose, Towsley, Schulzrinne 1994 (adaptive playout).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "session/probe_coding.hpp"
#include "session/transit.hpp"

namespace tactus::session {

struct PlayoutSettings {
  std::int64_t max_delay_ns = 80'000'000;  ///< later states come too late
  std::int64_t reserve_ns = 2'000'000;     ///< beyond the transit, for a successor to fill in for a lost state
};

struct Shown {
  ProbeView view;
  ProbeState state;        ///< the newest that this rests on
  std::int64_t at_ns = 0;  ///< session time that is shown
  bool stale = true;       ///< no state for three keep-alive periods
};

class ProbePlayout {
 public:
  explicit ProbePlayout(const PlayoutSettings& settings = {}) noexcept : settings_{settings} {}

  /// A state arrives. One of another incarnation starts anew, and so does one after session time has stepped back;
  /// repetitions and overtaken ones find their place.
  void on_state(const ProbeState& state, std::int64_t session_now_ns) noexcept;
  /// What to show now; nothing yet when `stale` with a state of sequence 0.
  [[nodiscard]] Shown at(std::int64_t session_now_ns) noexcept;
  /// From now on; P follows as it would have.
  void set(const PlayoutSettings& settings) noexcept { settings_ = settings; }
  /// P, now.
  [[nodiscard]] std::int64_t delay_ns() const noexcept { return delay_ns_; }

 private:
  static constexpr std::size_t kKept = 128;
  void keep(const ProbeState& state) noexcept;
  void watch(std::int64_t transit_ns, std::int64_t now_ns) noexcept;

  PlayoutSettings settings_;
  std::array<ProbeState, kKept> states_;  // ascending by sequence
  std::size_t count_ = 0;
  TransitWatch transit_;
  std::int64_t delay_ns_ = 0, moved_ns_ = 0, shown_ns_ = INT64_MIN;
  bool started_ = false;
};

}  // namespace tactus::session
