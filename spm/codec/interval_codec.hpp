/// Intervals of numbers as bits: their count, then for each the gap to the previous interval and its length less one.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "spm/codec/record_codes.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

void put_intervals(BitWriter& out, const RecordTables& tables, std::span<const Interval> intervals);

/// Reads ascending intervals of numbers below `limit` that do not touch. `total`: sum of their lengths. Returns a
/// description of the first error, or an empty string.
[[nodiscard]] std::string get_intervals(BitReader& in, const RecordTables& tables, std::uint32_t limit,
                                        std::vector<Interval>& intervals, std::uint32_t& total);

}  // namespace tactus::spm::codec
