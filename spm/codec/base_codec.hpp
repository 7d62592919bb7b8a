/// The base mesh as bytes: summary, base vertices, base faces, labelled cells without their record lists, and the
/// tables that the records are read with.
///
///     version | digest | counts | bounds, grid, unit, deviation, position step | positions | radii |
///     base faces | regions | tables
///     positions: in the lossless profile floats, in the compact one signed differences to the vertex before, on the
///     grid face:   (signed difference to the face before << 1 | last), three signed differences, each to the corner
///     before region: cell x, y, z, depth, record count, parts beyond it, face count, seal
///
/// Floats, bounds, grid, seals and digest are raw little-endian values, all else varints.
#pragma once

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

/// Trusts nothing: memory stays within a small multiple of the input, and the mesh returned has no violations().
Result<DecodedBase> decode_base(Span<const std::uint8_t> bytes);

}  // namespace tactus::spm::codec
