/// A recorded movement sent as coded probe states, and what a receiver shows of it against what was felt.
#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "bench/figures.hpp"
#include "session/playout.hpp"
#include "session/probe_coding.hpp"

namespace tactus::bench {

/// Of a movement, one each millisecond.
using States = std::vector<session::ProbeState>;

/// Which states of a movement an encoder sends, by their place in it.
[[nodiscard]] std::vector<std::uint32_t> encode(const States& states, const session::CodingSettings& settings);

/// A state sent, by its place in the movement, and when it arrived on the movement's clock.
struct CodedArrival {
  std::int64_t at_ns = 0;
  std::uint32_t place = 0;
};

/// As a line without delay or loss brings them.
[[nodiscard]] std::vector<CodedArrival> on_time(const States& states, const std::vector<std::uint32_t>& sent);

/// What was shown each millisecond, against what was felt at the time that it shows.
struct Fidelity {
  Samples jnd;  ///< |force error| in just noticeable differences
  double rms_jnd = 0;
  double rms_force = 0;    ///< N
  double above_share = 0;  ///< of the time that the error is above one
  Samples position;        ///< m, of the device
  Samples delay;           ///< ms, of what is shown
};

/// `arrivals` ascend; `sent` as they were. The first second is not judged, as the playout finds its delay.
[[nodiscard]] Fidelity play(const States& states, const std::vector<std::uint32_t>& sent,
                            const std::vector<CodedArrival>& arrivals, const session::PlayoutSettings& settings,
                            const session::Jnd& jnd = {});

}  // namespace tactus::bench
