/// Intervals of numbers as bits: their count, then for each the gap to the run before and its length less one.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "spm/codec/record_codes.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

void put_intervals(BitWriter& out, const RecordTables& tables, Span<const Interval> intervals);

/// Ascending intervals that do not touch, of numbers below `limit`, `total` of them together. Returns what is wrong, in
/// words; empty when nothing is.
[[nodiscard]] std::string get_intervals(BitReader& in, const RecordTables& tables, std::uint32_t limit,
                                        std::vector<Interval>& intervals, std::uint32_t& total);

}  // namespace tactus::spm::codec
