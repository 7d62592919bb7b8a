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
/// least one number between two of them. Fails if the bytes of the list or of these records are damaged, or if the list
/// does not have these records. Costs as much as CompressedModel::put_records; allocates.
Result<Bytes> encode_region(const CompressedModel& model, RegionId region, std::span<const Interval> missing);

/// A record in a message: its anchor, and the bits of its code without the anchor.
struct RecordCode {
  FaceId anchor;
  std::uint64_t first;  ///< position of the first bit in the message
  std::uint64_t bits;   ///< number of bits
};

/// A message whose records are checked, but not decoded.
struct RegionCodes {
  RegionId region{};
  std::vector<Interval> list, sent;  ///< as in RegionData
  std::vector<RecordCode> codes;     ///< of the sent records, in order
  bool is_too_long = false;          ///< the list has too many records; `list`, `sent` and `codes` are empty
};

/// Decodes bytes that are not trusted. Checks everything that does not depend on the receiver's state: form and order
/// of the intervals, every code, and every id and count against the counts of `summary`. Less than 0.1 us a record;
/// allocates up to 200 bytes for each byte of the message.
Result<RegionData> decode_region(std::span<const std::uint8_t> bytes, const ModelSummary& summary,
                                 const RecordTables& tables);

/// Checks a message as decode_region does. Allocates at most 50 bytes for each of `max_records`. If the list has more
/// records, checks nothing after that.
Result<RegionCodes> check_region(std::span<const std::uint8_t> bytes, const ModelSummary& summary,
                                 const RecordTables& tables, std::uint32_t max_records);

}  // namespace tactus::spm::codec
