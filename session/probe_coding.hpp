/// Deadband coding of probe states: the sender omits states that a receiver extrapolates closely enough.
///
///     HRTC      o . . . . o . . . . . . . o . o . . . .     o sent, . omitted: within the deadband
///     receiver  o - - - - o - - - - - - - o - o - - - -     - extrapolated
///
/// The deadband is the just noticeable difference: 10 % of a force (Weber), at least 0.05 N; 1 mm of a position. The
/// sender extrapolates as receivers do, so it knows their error. With losses it does not know which state a receiver
/// has, only the probability of each. It sends as soon as the states that would mislead a receiver have together more
/// than the probability `risk`. Without losses that is the plain deadband. With losses it repeats, with the newest
/// state, as long as older states would mislead.
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

inline constexpr std::int64_t kKeepAliveNs = 40'000'000;

/// Position and force of a probe at one time; world frame, SI.
struct ProbeView {
  std::array<double, 3> device{0, 0, 0};
  std::array<double, 3> proxy{0, 0, 0};
  std::array<double, 3> force{0, 0, 0};
};

/// Extrapolates `state` forwards or backwards to `at_ns` (dead reckoning): the device by its velocity; in contact the
/// proxy by the tangential part of the velocity, and the force by the normal part times the stiffness. After a
/// keep-alive period the motion dies out.
[[nodiscard]] ProbeView reckon(const ProbeState& state, std::int64_t at_ns) noexcept;

struct Jnd {
  double force_share = 0.1;   ///< of the force
  double force_floor = 0.05;  ///< N, min noticeable force
  double position = 0.001;    ///< m, of device and proxy

  /// |difference| of two forces in just noticeable differences; `felt` is the true force.
  [[nodiscard]] double of_force(const std::array<double, 3>& felt, const std::array<double, 3>& shown) const noexcept;
};

struct CodingSettings {
  Jnd jnd;
  double loss = 0;      ///< share of states that a receiver misses
  double risk = 0.005;  ///< max probability that a receiver is misled
};

/// For one probe.
class ProbeEncoder {
 public:
  explicit ProbeEncoder(const CodingSettings& settings = {}) noexcept : settings_{settings} {}

  /// Call it once a cycle; true when the state has to be sent, at least every kKeepAliveNs.
  [[nodiscard]] bool step(const ProbeState& state) noexcept;
  /// Applies from the next step on.
  void set_loss(double loss) noexcept { settings_.loss = loss; }

 private:
  static constexpr std::size_t kSent = 8;
  [[nodiscard]] bool misleads(const ProbeState& sent, const ProbeState& state) const noexcept;

  CodingSettings settings_;
  std::array<ProbeState, kSent> sent_;  // the last ones, a ring
  std::uint64_t count_ = 0;             // sent so far
};

}  // namespace tactus::session
