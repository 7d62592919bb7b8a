/// Probe states sent only when a receiver would feel the difference, and what a receiver makes of those it has.
///
///     HRTC      o . . . . o . . . . . . . o . o . . . .     o sent, . within what is reckoned from the one before
///     receiver  o - - - - o - - - - - - - o - o - - - -     - reckoned
///
/// The criterion is the just noticeable difference: of a force a tenth of it (Weber), at least 0.05 N; of a position
/// 1 mm. The sender reckons as receivers do, so it knows what they take the probe for. Where states are lost it does
/// not know which one a receiver has, but how likely each is: it sends as soon as those that would mislead are
/// together likelier than `risk`. Without losses that is the plain deadband; with them it repeats, with the newest
/// state, as often as it takes, and only as long as the older ones would mislead.
///
/// No clock and no DDS in it: times are session time. One thread at a time. Does not allocate.
/// Sources: Hinterseer, Steinbach 2006 (isotropic deadband); Kammerl, Vittorias et al. 2012 (losses as a probability of
/// the receiver's state).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "session/messages.hpp"

namespace tactus::session {

inline constexpr std::int64_t kKeepAliveNs = 40'000'000;

/// Where a probe is and what it feels at a time; world frame, SI.
struct ProbeView {
  std::array<double, 3> device{0, 0, 0};
  std::array<double, 3> proxy{0, 0, 0};
  std::array<double, 3> force{0, 0, 0};
};

/// `state` carried on to `at_ns`, or back: the device by its velocity; in contact the proxy by what of that lies along
/// the surface, and the force by what does not, as the spring between the two has it. Beyond a keep-alive period
/// the motion dies out.
[[nodiscard]] ProbeView reckon(const ProbeState& state, std::int64_t at_ns) noexcept;

struct Jnd {
  double force_share = 0.1;   ///< of the force
  double force_floor = 0.05;  ///< N; below it no force is told from none
  double position = 0.001;    ///< m, of device and proxy

  /// |difference| of two forces in just noticeable differences, `felt` being the true one.
  [[nodiscard]] double of_force(const std::array<double, 3>& felt, const std::array<double, 3>& shown) const noexcept;
};

struct CodingSettings {
  Jnd jnd;
  double loss = 0;      ///< share of states that a receiver misses
  double risk = 0.005;  ///< that a receiver is misled
};

/// For one probe.
class ProbeEncoder {
 public:
  explicit ProbeEncoder(const CodingSettings& settings = {}) noexcept : settings_{settings} {}

  /// Once a cycle with its state; true when that has to be sent. Never silent for longer than kKeepAliveNs.
  [[nodiscard]] bool step(const ProbeState& state) noexcept;
  /// From the next step on.
  void set_loss(double loss) noexcept { settings_.loss = loss; }

 private:
  static constexpr std::size_t kSent = 8;
  [[nodiscard]] bool misleads(const ProbeState& sent, const ProbeState& state) const noexcept;

  CodingSettings settings_;
  std::array<ProbeState, kSent> sent_;  // the last ones, in a ring
  std::uint64_t count_ = 0;             // sent so far
};

}  // namespace tactus::session
