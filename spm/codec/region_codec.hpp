/// A region message as bits: the region's closed record list, and those of its records that the receiver lacks.
///
///     region | intervals of the list | intervals of the sent records | sent records, in order
///     intervals:  count, then for each the gap to the previous interval and the length less one. The intervals of the
///                 sent records count positions in the list.
///
/// The code of a record is the same in every message; only its anchor is relative to the previous record in the message
/// (see record_codes.hpp). So any host can send any subset of records to any receiver.
#pragma once

#include <span>
#include <vector>

#include "spm/codec/compressed_model.hpp"
#include "spm/codec/result.hpp"
#include "spm/region_data.hpp"

namespace tactus::spm::codec {

/// `missing`: a subset of the region's list as ascending intervals that do not touch. Cost: see
/// CompressedModel::put_records.
[[nodiscard]] Bytes encode_region(const CompressedModel& model, RegionId region, std::span<const Interval> missing);

/// The position of a record's code in a message, without its anchor.
struct RecordCode {
  FaceId anchor;
  std::uint64_t first, bits;
};

/// The bytes are not trusted. Memory is at most a small multiple of the input. Checks all that does not depend on the
/// receiver's state: form and order of the intervals, every code, every id against the counts of `summary`. Less than
/// 0.1 us a record. `codes`, if given, is set to the positions of the records in the message, in order.
Result<RegionData> decode_region(std::span<const std::uint8_t> bytes, const ModelSummary& summary,
                                 const RecordTables& tables, std::vector<RecordCode>* codes = nullptr);

}  // namespace tactus::spm::codec
