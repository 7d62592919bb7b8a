/// A region as bits: its closed record list, and those of its records that the receiver lacks.
///
///     region | intervals of the list | intervals sent | sent records, in order
///     intervals:  count, then for each: gap to the run before, length less one; those sent count places in the list
///
/// A record's code is the same in every message, so any host may send any record to anyone, in any company; only its
/// anchor is told as the difference to that of the record before (see record_codes.hpp).
#pragma once

#include <vector>

#include "spm/codec/compressed_model.hpp"
#include "spm/codec/result.hpp"
#include "spm/region_data.hpp"

namespace tactus::spm::codec {

/// `missing` is a subset of the region's list, ascending intervals that do not touch. The codes are copied:
/// see CompressedModel::put_records for the cost.
[[nodiscard]] Bytes encode_region(const CompressedModel& model, RegionId region, Span<const Interval> missing);

/// Where a record's code is in a message, from behind its anchor on.
struct RecordCode {
  std::uint32_t anchor;
  std::uint64_t first, bits;
};

/// Trusts nothing: memory stays within a small multiple of the input. Everything that can be known without the
/// receiver's state is checked here: form and order of the intervals, every code, every id against the counts of
/// `summary`. Less than 0.1 us a record. `codes`, when given, gets those of the records in the message, in order.
Result<RegionData> decode_region(Span<const std::uint8_t> bytes, const ModelSummary& summary,
                                 const RecordTables& tables, std::vector<RecordCode>* codes = nullptr);

}  // namespace tactus::spm::codec
