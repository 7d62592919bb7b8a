/// Codes a simulated movement with a deadband, and measures the error of the states that a receiver shows.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "bench/figures.hpp"
#include "session/playout.hpp"
#include "session/probe_coding.hpp"

namespace tactus::bench {

/// Probe states of a movement, one for each millisecond. Below, the index in this list identifies a state.
using States = std::vector<session::ProbeState>;

/// Returns the indices of the states that an encoder sends.
[[nodiscard]] std::vector<std::uint32_t> encode(const States& states, const session::CodingSettings& settings);

/// A state that arrived.
struct CodedArrival {
  std::int64_t at_ns = 0;   ///< session time of the arrival
  std::uint32_t index = 0;  ///< of the state in the movement
};

/// Returns the arrivals over a link without delay and loss.
[[nodiscard]] std::vector<CodedArrival> arrivals_without_delay(const States& states,
                                                               const std::vector<std::uint32_t>& sent);

/// Differences between the view that the receiver shows in each millisecond and the true state of the same session
/// time.
struct Fidelity {
  Samples jnd;             ///< |force error|, in just noticeable differences
  double rms_jnd = 0;      ///< rms of `jnd`
  double rms_force = 0;    ///< N, rms of the force error
  double above_share = 0;  ///< share of the views whose force error is above 1 JND
  Samples position;        ///< m, |error| of the device position
  Samples delay;           ///< ms, playout delay of each view
};

/// Returns the errors of a receiver that gets `arrivals`, sorted by time. `sent` are the indices of the states sent.
/// Does not measure the first second, because the playout delay still adapts.
[[nodiscard]] Fidelity play(const States& states, const std::vector<std::uint32_t>& sent,
                            const std::vector<CodedArrival>& arrivals, const session::PlayoutSettings& settings,
                            const session::Jnd& jnd = {});

}  // namespace tactus::bench
