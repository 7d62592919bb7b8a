/// Users who take an object from each other: the ownership of session/ownership.hpp over links, in virtual time.
#pragma once

#include "netem/profile.hpp"
#include "study/fidelity.hpp"

namespace tactus::study {

/// A user at a controller of its own: what its touches take and what is between them, s, means; evenly from a tenth of
/// that on.
struct Toucher {
  double hold = 1, pause = 1;
};

/// Host and controllers a `link` apart, each from each. The truth is the state machine's: under one fencing number only
/// one program ever publishes poses.
[[nodiscard]] Figures hand_over(const std::vector<Toucher>& users, double seconds, const netem::LinkSettings& link,
                                std::uint64_t seed);

}  // namespace tactus::study
