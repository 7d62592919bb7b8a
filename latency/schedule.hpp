/// The ticks at which the pings of a test are due.
#pragma once

#include <cstdint>
#include <vector>

#include "latency/cell.hpp"

namespace tactus::latency {

/// Ticks of the test's rate, ascending from 0. A coded test has only those whose probe states the deadband coder of an
/// HRTC sends for one hand. That hand strokes a surface of 1,000 N/m at up to 5 cm/s, presses by up to 1.6 mm, leaves
/// it twice in three seconds, and has a tremor of 0.1 mm at 9 Hz.
[[nodiscard]] std::vector<std::uint32_t> ticks_of(const Cell& cell);

}  // namespace tactus::latency
