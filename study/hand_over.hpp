/// Runs the ownership protocol of session/ownership.hpp over links in virtual time: users take over an object from each
/// other.
#pragma once

#include "netem/profile.hpp"
#include "study/fidelity.hpp"

namespace tactus::study {

/// A user at an HRTC of its own.
struct HandOverUser {
  /// Mean durations of the touches and of the pauses between them, s; uniformly distributed from 0.1 to 1.9 of the
  /// mean.
  double hold = 1, pause = 1;
};

/// Runs a host and an HRTC for each user for `seconds`, with a `link` between each pair, and returns the figures. One
/// of them counts violations of the protocol: programs that publish poses under the fencing number of another one.
[[nodiscard]] Figures hand_over(const std::vector<HandOverUser>& users, double seconds, const netem::LinkSettings& link,
                                std::uint64_t seed);

}  // namespace tactus::study
