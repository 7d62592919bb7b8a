/// The base mesh as bytes: summary, base vertices, base faces, labelled cells without their record lists.
///
///     version | digest | counts | bounds, grid, unit, deviation | positions | radii | base faces | regions
///     face:   (signed difference to the face before << 1 | last), three signed differences, each to the corner before
///     region: cell x, y, z, depth, record, part and face counts
///
/// Coordinates, bounds, grid and digest are raw little-endian values, all else varints.
#pragma once

#include "spm/codec/bytes.hpp"
#include "spm/codec/result.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

/// O(base mesh + regions).
[[nodiscard]] Bytes encode_base(const Model& model);

/// Trusts nothing: memory stays within a small multiple of the input, and what is returned has no violations().
Result<BaseMesh> decode_base(Span<const std::uint8_t> bytes);

}  // namespace tactus::spm::codec
