/// What the records of a region stand on, as one number that comes with the base mesh: so that a message which leaves
/// out what a record needs is refused, although nothing in it contradicts what is held.
///
/// A record's seal is a sum over the vertices around its split (VertexRing), by id, in whatever order; a region's is
/// the sum over its list. A guard against damage and mistakes, not a signature.
#pragma once

#include <cstdint>
#include <vector>

#include "spm/model.hpp"
#include "spm/vertex_ring.hpp"

namespace tactus::spm {

/// `id_of` gives the VertexId of what the ring holds.
template <class IdOf>
[[nodiscard]] std::uint32_t checksum_of(std::uint32_t u, const VertexRing& ring, IdOf id_of) noexcept {
  std::uint64_t sum = 0;
  for (std::uint32_t i = 0; i < ring.size(); ++i) {
    const std::uint64_t pair = std::uint64_t{u} << 32 | id_of(ring[i]);
    sum += (pair ^ pair >> 29) * 0x9e3779b97f4a7c15ull;
  }
  return static_cast<std::uint32_t>(sum >> 32);
}

/// By record. O(size), allocates.
[[nodiscard]] std::vector<std::uint32_t> record_checksums(const Model& model);

/// Of one region by those of its records, over its intervals.
[[nodiscard]] std::uint32_t region_checksum(const Model& model, RegionId region,
                                            const std::vector<std::uint32_t>& records);

/// By region; sums wrap. `model` must be sound up to its seals. O(size), allocates.
[[nodiscard]] std::vector<std::uint32_t> region_checksums(const Model& model);

}  // namespace tactus::spm
