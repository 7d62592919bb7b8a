/// Computes the times at which the pings of a test are due.
#pragma once

#include <cstdint>
#include <vector>

#include "latency/test_case.hpp"

namespace tactus::latency {

/// Returns the numbers of the ticks with a ping, ascending from 0. Without coding, these are all ticks of the test's
/// rate. With coding, they are the ticks whose probe state the deadband coder of an HRTC sends for a simulated hand.
/// The hand strokes a surface of 1,000 N/m at up to 5 cm/s and presses up to 1.6 mm into it. It loses contact twice in
/// three seconds and has a tremor of 0.1 mm at 9 Hz.
[[nodiscard]] std::vector<std::uint32_t> ticks_of(const TestCase& test);

}  // namespace tactus::latency
