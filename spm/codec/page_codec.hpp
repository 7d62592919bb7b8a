/// Encodes and decodes the directory of a model: its regions, without their lists.
///
///     page:      page | first region | number of regions | regions
///     region:    cell x, y, z, depth, occupied subcells, records, parts minus records, faces, checksum
///
/// Occupied subcells and checksum are raw, little-endian. All other values are varints. The cells of a page are
/// relative to its first cell at their depth.
#pragma once

#include <span>
#include <vector>

#include "spm/codec/bytes.hpp"
#include "spm/codec/result.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

/// Encodes all regions of a model. O(regions).
[[nodiscard]] Bytes encode_regions(std::span<const Region> regions);
/// Decodes the regions of the model with this summary, which must have no violations(). The result is checked like a
/// Page. Uses at most a small multiple of the bytes as memory.
Result<std::vector<Region>> decode_regions(std::span<const std::uint8_t> bytes, const ModelSummary& summary);

/// Encodes a page. O(its regions).
[[nodiscard]] Bytes encode_page(const Page& page);
/// Decodes bytes that are not trusted. `summary` must have no violations(), and the result has none. Uses at most a
/// small multiple of the bytes as memory.
Result<Page> decode_page(std::span<const std::uint8_t> bytes, const ModelSummary& summary);

/// Encodes all pages of a model that have regions: for each page, its size as a varint, and its bytes. O(regions).
[[nodiscard]] Bytes encode_pages(std::span<const Region> regions);
/// Decodes as decode_page.
Result<std::vector<Page>> decode_pages(std::span<const std::uint8_t> bytes, const ModelSummary& summary);

}  // namespace tactus::spm::codec
