/// Delays the states of a remote probe by a playout delay that is just long enough for nearly all states.
///
///     state of 10 ms   -----> arrives 15.2        shown at 10 + P
///     state of 20 ms   ------------> arrives 27   shown at 20 + P       P: playout delay
///
/// The playout delay P is the longest recent transit without outliers (session/transit.hpp), plus a reserve. When P
/// rises, it rises at once, and the shown time stands still for the difference. P falls by at most 1 % of the elapsed
/// time. So the receiver shows the past at a nearly constant rate, with a known age. Between two states with
/// consecutive numbers, the receiver extrapolates the first (`extrapolate`): the sender makes sure that this
/// extrapolation stays within the deadband. If states between two were lost, the receiver interpolates.
///
/// Times are session time; a constant clock error has no effect. One thread at a time. Does not allocate.
/// Source: Ramjee, Kurose, Towsley, Schulzrinne 1994 (adaptive playout).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "session/probe_coding.hpp"
#include "session/transit.hpp"

namespace tactus::session {

struct PlayoutSettings {
  std::int64_t max_delay_ns = 80'000'000;  ///< max P; states with a longer transit arrive too late
  std::int64_t reserve_ns = 2'000'000;     ///< added to the transit: time for the successor of a lost state to arrive
};

/// The view of a probe to show at a time.
struct ShownProbe {
  ProbeView view;
  ProbeState state;        ///< the state from which the view is computed
  std::int64_t at_ns = 0;  ///< session time of the view
  bool stale = true;       ///< no state for three keep-alive periods
};

/// The playout of one probe.
class ProbePlayout {
 public:
  explicit ProbePlayout(const PlayoutSettings& settings = {}) noexcept : settings_{settings} {}

  /// Takes a state. States out of order are inserted by number; repeated states are ignored. A state of another
  /// incarnation, or a step back of session time, starts the playout anew.
  void on_state(const ProbeState& state, std::int64_t session_now_ns) noexcept;
  /// Returns the view to show now. Before the first state it is stale and has sequence 0.
  [[nodiscard]] ShownProbe view_at(std::int64_t session_now_ns) noexcept;
  /// Changes the settings. P rises at once or falls gradually.
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
  std::int64_t delay_ns_ = 0;
  std::int64_t updated_ns_ = 0;        // when delay_ns_ was updated
  std::int64_t shown_ns_ = INT64_MIN;  // session time of the last view
  bool started_ = false;
};

}  // namespace tactus::session
