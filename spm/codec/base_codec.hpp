/// Encodes and decodes the base mesh message. It has the summary, base vertices, base faces, and the prefix codes of
/// the records.
///
///     version | digest | counts | bounds, grid, unit, deviation, position step | positions | radii |
///     base faces | tables
///
///     positions: lossless profile: floats; compact profile: signed differences to the previous vertex, in steps
///     face:      2 x (signed difference to the previous face) + (1 if finest), and for each of the three corners the
///                signed difference to the previous corner
///     tables:    number of bytes, prefix codes
///
/// Counts and differences are varints. All other values are raw, little-endian.
#pragma once

#include <span>

#include "spm/codec/bytes.hpp"
#include "spm/codec/record_codes.hpp"
#include "spm/codec/result.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

/// Encodes the base mesh of `model`. O(base mesh).
[[nodiscard]] Bytes encode_base(const Model& model, const RecordTables& tables);

struct DecodedBase {
  BaseMesh mesh;
  RecordTables tables;
};

/// Decodes bytes that are not trusted. Uses at most a small multiple of their size as memory. The result has no
/// violations().
Result<DecodedBase> decode_base(std::span<const std::uint8_t> bytes);

}  // namespace tactus::spm::codec
