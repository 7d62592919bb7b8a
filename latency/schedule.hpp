/// When the pings of a test are due.
#pragma once

#include <cstdint>
#include <vector>

#include "latency/cell.hpp"

namespace tactus::latency {

/// Ticks of the test's rate, from 0 on, ascending. All of them; or, of a coded test, those whose probe states a
/// controller would send of one hand: it strokes a surface of 1,000 N/m at up to 5 cm/s, presses on it by up to 1.6 mm
/// and leaves it twice in three seconds, and trembles by 0.1 mm at 9 Hz.
[[nodiscard]] std::vector<std::uint32_t> ticks_of(const Cell& cell);

}  // namespace tactus::latency
