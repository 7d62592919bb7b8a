/// Adds rows about deadband-coded probe states to the benchmarks of full-rate states. The hand follows a surface at
/// 5 cm/s.
#pragma once

#include <cstdint>
#include <string>

#include "bench/figures.hpp"

namespace tactus::bench {

/// Adds rows for the link P0 with a loss of `percent` of the frames. The encoder knows this loss. The p99 of the force
/// error has the bound 1 JND. The movement takes `seconds`.
void add_coded_loss(Report& report, double percent, double seconds, std::uint64_t seed);

/// Adds rows for a link of `mbit` Mbit/s that mesh records fill. The p99 of the age has the bound `bound_ms`. The
/// mesh records have to use 40 % of the link.
void add_coded_isolation(Report& report, double mbit, double seconds, double bound_ms);

}  // namespace tactus::bench
