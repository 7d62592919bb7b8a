/// What benchmarks of uncoded probe states say of coded ones beside them: a hand that follows a surface at 5 cm/s.
#pragma once

#include <cstdint>
#include <string>

#include "bench/figures.hpp"

namespace tactus::bench {

/// Force error and packets over P0 that loses `percent` of the frames, the sender knowing how many; bounds the error at
/// p99 to one just noticeable difference. Takes `seconds` and some.
void add_coded_loss(Report& report, double percent, double seconds, std::uint64_t seed);

/// Age and force error beside mesh records on a link of `mbit`; bounds the age at p99 to `bound_ms`.
void add_coded_isolation(Report& report, double mbit, double seconds, double bound_ms);

}  // namespace tactus::bench
