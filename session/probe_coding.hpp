/// Deadband coding of probe states: the sender omits states that a receiver extrapolates closely enough.
///
///     HRTC      o . . . . o . . . . . . . o . o . . . .     o sent, . omitted: within the deadband
///     receiver  o - - - - o - - - - - - - o - o - - - -     - extrapolated
///
/// The deadband is the just noticeable difference: 10 % of a force (Weber) but at least 0.05 N, and 1 mm of a position.
/// A sent state misleads a receiver if its extrapolation differs from the present state by more than the deadband. The
/// sender extrapolates as receivers do, so it can compute this. With losses the sender does not know which state a
/// receiver has, only the probability of each. It sends the present state when the states that mislead together have a
/// probability above `risk`. Without losses this is the plain deadband. With losses the sender continues to send states
/// until older ones no longer mislead, or have too small a probability.
///
/// No clock and no DDS: times are session time. One thread at a time. Does not allocate.
/// Sources: Hinterseer, Steinbach 2006 (isotropic deadband); Kammerl, Vittorias et al. 2012 (losses as a probability of
/// the receiver's state).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "session/messages.hpp"

namespace tactus::session {

/// Max time between two sent states of a probe.
inline constexpr std::int64_t kKeepAliveNs = 40'000'000;

/// Position and force of a probe at one time; world frame, SI.
struct ProbeView {
  std::array<double, 3> device{0, 0, 0};
  std::array<double, 3> proxy{0, 0, 0};
  std::array<double, 3> force{0, 0, 0};
};

/// Extrapolates `state` forwards or backwards to `at_ns` (dead reckoning). The device moves by its velocity. In contact
/// the proxy moves by the tangential part of the velocity, and the force changes by the normal part times the
/// stiffness. After a keep-alive period the motion decays.
[[nodiscard]] ProbeView extrapolate(const ProbeState& state, std::int64_t at_ns) noexcept;

/// Just noticeable differences.
struct Jnd {
  double force_share = 0.1;   ///< of the force
  double force_floor = 0.05;  ///< N, min noticeable force
  double position = 0.001;    ///< m, of device and proxy

  /// |felt - shown| as a multiple of the just noticeable difference at the true force `felt`.
  [[nodiscard]] double force_difference(const std::array<double, 3>& felt,
                                        const std::array<double, 3>& shown) const noexcept;
};

struct CodingSettings {
  Jnd jnd;
  double loss = 0;      ///< share of states that a receiver misses
  double risk = 0.005;  ///< max probability that a receiver is misled
};

/// Decides which states of one probe are sent.
class ProbeEncoder {
 public:
  explicit ProbeEncoder(const CodingSettings& settings = {}) noexcept : settings_{settings} {}

  /// Returns whether the state has to be sent. Call it once a cycle.
  [[nodiscard]] bool step(const ProbeState& state) noexcept;
  /// Sets the share of lost states from the next step on.
  void set_loss(double loss) noexcept { settings_.loss = loss; }

 private:
  static constexpr std::size_t kSent = 8;
  [[nodiscard]] bool misleads(const ProbeState& sent, const ProbeState& state) const noexcept;

  CodingSettings settings_;
  std::array<ProbeState, kSent> sent_;  // the newest sent states, a ring
  std::uint64_t count_ = 0;             // number of sent states
};

}  // namespace tactus::session
