/// A checksum of the vertices on which a region's records depend. It is part of the base mesh. A region message whose
/// list lacks a needed record can be consistent with everything that is loaded; its checksum then differs.
///
/// The checksum of a record is a sum over the vertices around its split (VertexRing), by id, in any order. The checksum
/// of a region is the sum over its list. It detects damage and mistakes; it is not a signature.
#pragma once

#include <cstdint>
#include <vector>

#include "spm/model.hpp"
#include "spm/vertex_ring.hpp"

namespace tactus::spm {

/// `id_of` maps a vertex of the ring to its VertexId.
template <class Vertex, class IdOf>
[[nodiscard]] std::uint32_t checksum_of(VertexId u, const VertexRing<Vertex>& ring, IdOf id_of) noexcept {
  std::uint64_t sum = 0;
  for (std::uint32_t i = 0; i < ring.size(); ++i) {
    const std::uint64_t pair = std::uint64_t{index(u)} << 32 | index(id_of(ring[i]));
    sum += (pair ^ pair >> 29) * 0x9e3779b97f4a7c15ull;
  }
  return static_cast<std::uint32_t>(sum >> 32);
}

/// By record. O(size), allocates.
[[nodiscard]] std::vector<std::uint32_t> record_checksums(const Model& model);

/// Of one region, from the checksums of all records.
[[nodiscard]] std::uint32_t region_checksum(const Model& model, RegionId region,
                                            const std::vector<std::uint32_t>& records);

/// By region. Sums wrap. `model` must be sound except for its checksums. O(size), allocates.
[[nodiscard]] std::vector<std::uint32_t> region_checksums(const Model& model);

}  // namespace tactus::spm
