/// The base mesh as bytes: summary, base vertices, base faces, labelled cells without their record lists, and the
/// prefix codes of the records.
///
///     version | digest | counts | bounds, grid, unit, deviation, position step | positions | radii |
///     base faces | regions | tables
///
///     positions: lossless profile: floats; compact profile: signed differences to the previous vertex, in steps
///     face:      (signed difference to the previous face << 1 | last), three signed differences to the previous corner
///     region:    cell x, y, z, depth, occupied parts, record count, parts beyond it, face count, checksum
///
/// Floats, bounds, grid, checksums and digest are raw little-endian values; all others are varints.
#pragma once

#include <span>

#include "spm/codec/bytes.hpp"
#include "spm/codec/record_codes.hpp"
#include "spm/codec/result.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

/// O(base mesh + regions).
[[nodiscard]] Bytes encode_base(const Model& model, const RecordTables& tables);

struct DecodedBase {
  BaseMesh mesh;
  RecordTables tables;
};

/// The bytes are not trusted. Memory is at most a small multiple of the input; the result has no violations().
Result<DecodedBase> decode_base(std::span<const std::uint8_t> bytes);

}  // namespace tactus::spm::codec
