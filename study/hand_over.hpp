/// Runs the ownership protocol of session/ownership.hpp over links in virtual time: users take over an object from each
/// other.
#pragma once

#include "netem/profile.hpp"
#include "study/fidelity.hpp"

namespace tactus::study {

/// A user at an HRTC of its own.
struct HandOverUser {
  /// Mean durations of the touches and of the pauses between them, s. Each duration is uniformly distributed between
  /// 0.1 and 1.9 times its mean.
  double hold = 1, pause = 1;
};

/// Runs a host and an HRTC for each user for `seconds`, with a `link` between each pair, and returns the figures. The
/// figure "shared fencing numbers" counts violations of the protocol: poses that a program publishes under a fencing
/// number of another program.
[[nodiscard]] Figures hand_over(const std::vector<HandOverUser>& users, double seconds, const netem::LinkSettings& link,
                                std::uint64_t seed);

}  // namespace tactus::study
