/// Encodes and decodes a region message: the region's closed list, and the listed records that the receiver lacks.
///
///     region | intervals of the list | intervals of the sent records | sent records, in order
///
/// interval_codec.hpp describes the intervals. The intervals of the sent records are positions in the list, not record
/// numbers. The code of a record is the same in every message, except its anchor, which depends on the previous records
/// in the message (record_codes.hpp). So any host can send any subset of the list to any receiver.
#pragma once

#include <span>
#include <vector>

#include "spm/codec/compressed_model.hpp"
#include "spm/codec/result.hpp"
#include "spm/region_data.hpp"

namespace tactus::spm::codec {

/// Encodes the region with the records in `missing`: a subset of the region's list, as ascending intervals with at
/// least one number between two of them. Fails if the bytes of the list or of these records are damaged. Costs as much as
/// CompressedModel::put_records; allocates.
Result<Bytes> encode_region(const CompressedModel& model, RegionId region, std::span<const Interval> missing);

/// A record in a message: its anchor, and the bits of its code without the anchor.
struct RecordCode {
  FaceId anchor;
  std::uint64_t first;  ///< position of the first bit in the message
  std::uint64_t bits;   ///< number of bits
};

/// Decodes bytes that are not trusted. Uses at most a small multiple of their size as memory. Checks everything that
/// does not depend on the receiver's state: form and order of the intervals, every code, and every id against the
/// counts of `summary`. Less than 0.1 us a record; allocates. If `codes` is not null, sets it to the records of the
/// message, in order.
Result<RegionData> decode_region(std::span<const std::uint8_t> bytes, const ModelSummary& summary,
                                 const RecordTables& tables, std::vector<RecordCode>* codes = nullptr);

}  // namespace tactus::spm::codec
