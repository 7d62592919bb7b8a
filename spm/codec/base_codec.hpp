/// The base mesh as bytes: summary, base vertices, base faces, labelled cells without their record lists.
///
/// Coordinates keep their float bits. The layout is in docs/wire_format.md.
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
