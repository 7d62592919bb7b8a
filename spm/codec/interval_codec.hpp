/// Encodes and decodes a list of intervals. The bits are the number of intervals, and for each interval the distance
/// from the end of the previous one and the length minus 1.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "spm/codec/record_codes.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

void put_intervals(BitWriter& out, const RecordTables& tables, std::span<const Interval> intervals);

/// Reads ascending intervals of numbers below `limit`. At least one number must lie between two intervals. Sets `total`
/// to the sum of the lengths. Returns a description of the first error, or an empty string.
[[nodiscard]] std::string get_intervals(BitReader& in, const RecordTables& tables, std::uint32_t limit,
                                        std::vector<Interval>& intervals, std::uint32_t& total);

}  // namespace tactus::spm::codec
