/// Playout of a remote probe: delays its states so that nearly all arrive in time, and no longer.
///
///     state of 10 ms   -----> arrives 15.2        shown at 10 + P
///     state of 20 ms   ------------> arrives 27   shown at 20 + P       P: playout delay
///
/// The playout delay P is the transit of nearly all states (session/transit.hpp). It rises at once and falls by 1 % of
/// the time passed. So the receiver shows a true past at an even rate, and knows its age. Between two states with
/// consecutive numbers it extrapolates the first (`reckon`), as the sender has checked. Where states between two were
/// lost, it interpolates.
///
/// For one probe. Times are session time; a clock error only matters where it changes. One thread at a time. Does not
/// allocate.
/// Source: Ramjee, Kurose, Towsley, Schulzrinne 1994 (adaptive playout).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "session/probe_coding.hpp"
#include "session/transit.hpp"

namespace tactus::session {

struct PlayoutSettings {
  std::int64_t max_delay_ns = 80'000'000;  ///< states with a longer transit come too late
  std::int64_t reserve_ns = 2'000'000;     ///< added to the transit, so that a successor can replace a lost state
};

struct Shown {
  ProbeView view;
  ProbeState state;        ///< the state from which the view is computed
  std::int64_t at_ns = 0;  ///< session time of the view
  bool stale = true;       ///< no state for three keep-alive periods
};

class ProbePlayout {
 public:
  explicit ProbePlayout(const PlayoutSettings& settings = {}) noexcept : settings_{settings} {}

  /// Takes a state. A state of another incarnation starts the playout anew, and so does a step back of session time.
  /// Repeated and overtaken states are inserted by number.
  void on_state(const ProbeState& state, std::int64_t session_now_ns) noexcept;
  /// The view to show now. Before the first state it is `stale` and has sequence 0.
  [[nodiscard]] Shown at(std::int64_t session_now_ns) noexcept;
  /// Changes the settings; P follows gradually.
  void set(const PlayoutSettings& settings) noexcept { settings_ = settings; }
  /// The playout delay P now.
  [[nodiscard]] std::int64_t delay_ns() const noexcept { return delay_ns_; }

 private:
  static constexpr std::size_t kCapacity = 128;
  void insert(const ProbeState& state) noexcept;
  void update_delay(std::int64_t transit_ns, std::int64_t now_ns) noexcept;

  PlayoutSettings settings_;
  std::array<ProbeState, kCapacity> states_;  // ascending by sequence
  std::size_t count_ = 0;
  TransitEstimator transit_;
  std::int64_t delay_ns_ = 0, moved_ns_ = 0, shown_ns_ = INT64_MIN;
  bool started_ = false;
};

}  // namespace tactus::session
