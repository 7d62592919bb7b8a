/// Computes a checksum of the vertices on which a region's records depend. If the list in a region message lacks a
/// needed record, the message may still fit the loaded mesh, but its checksum differs from the one in the base mesh.
///
/// The checksum of a record is a sum over the ids of the vertices around its split (VertexRing). The checksum of a
/// region is the sum of the checksums of its records. Sums wrap. Checksums detect damage and mistakes, but no forgery.
#pragma once

#include <cstdint>
#include <vector>

#include "spm/model.hpp"
#include "spm/vertex_ring.hpp"

namespace tactus::spm {

/// Returns the checksum of the record that adds `u`. `id_of` maps a vertex of the ring to its VertexId.
template <class Vertex, class IdOf>
[[nodiscard]] std::uint32_t checksum_of(VertexId u, const VertexRing<Vertex>& ring, IdOf id_of) noexcept {
  std::uint64_t sum = 0;
  for (std::uint32_t i = 0; i < ring.size(); ++i) {
    const std::uint64_t pair = std::uint64_t{index(u)} << 32 | index(id_of(ring[i]));
    sum += (pair ^ pair >> 29) * 0x9e3779b97f4a7c15ull;
  }
  return static_cast<std::uint32_t>(sum >> 32);
}

/// Returns the checksums of all records. O(size), allocates.
[[nodiscard]] std::vector<std::uint32_t> record_checksums(const Model& model);

/// Returns the checksum of a region from the checksums of all records.
[[nodiscard]] std::uint32_t region_checksum(const Model& model, RegionId region,
                                            const std::vector<std::uint32_t>& records);

/// Returns the checksums of all regions. `model` must have no violations except in its checksums. O(size), allocates.
[[nodiscard]] std::vector<std::uint32_t> region_checksums(const Model& model);

}  // namespace tactus::spm
