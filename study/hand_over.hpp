/// Users who take over an object from each other: the ownership protocol of session/ownership.hpp over links, in
/// virtual time.
#pragma once

#include "netem/profile.hpp"
#include "study/fidelity.hpp"

namespace tactus::study {

/// A user at an HRTC of its own: mean duration of its contacts and of the pauses between them, s; uniformly distributed
/// from a tenth of the mean.
struct Toucher {
  double hold = 1, pause = 1;
};

/// Host and HRTCs with a `link` between each pair. Ground truth is the protocol's: under one fencing number at most one
/// program ever publishes poses.
[[nodiscard]] Figures hand_over(const std::vector<Toucher>& users, double seconds, const netem::LinkSettings& link,
                                std::uint64_t seed);

}  // namespace tactus::study
