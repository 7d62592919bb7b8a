/// The dependencies of records: the records that must come before a record, so that every closed set is a valid mesh.
///
/// Record i needs (a) for each face that it deforms, the record that produces the previous version of the face, and (b)
/// the records of t and of all other corners of the faces that it produces. Rule (a) alone is not enough for ears at
/// borders: an ear deforms no face, but its vertices must exist.
/// Source: De Floriani, Magillo, Puppo 1997 (a closed set of a Multi-Triangulation is a mesh).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "spm/offline/simplify.hpp"

namespace tactus::spm::offline {

/// Collapses are numbered as if all segments were one sequence.
struct Dependencies {
  std::vector<std::uint32_t> segment;     ///< the first collapse of each segment, and the number of collapses
  std::vector<std::uint32_t> removed_by;  ///< by vertex: the collapse that removes it; kNone in the base mesh
  std::vector<std::uint32_t> first;  ///< collapse i needs `needs[first[i], first[i + 1])`, each later in the sequence
  std::vector<std::uint32_t> needs;  ///< each once, ascending
  std::vector<std::uint16_t> level;  ///< 1 + the highest level needed
  std::uint32_t max_level = 0;

  [[nodiscard]] std::uint32_t size() const noexcept { return segment.back(); }
  [[nodiscard]] std::span<const std::uint32_t> of(std::uint32_t i) const {
    return {needs.data() + first[i], first[i + 1] - first[i]};
  }
};

/// Afterwards `collapses.corners` is the finest mesh, and the moved corners of each collapse are in the order of
/// order_fan(). Throws ModelError if a dependency chain is longer than the maximum level.
[[nodiscard]] Dependencies dependencies(Collapses& collapses, std::size_t vertices, unsigned threads = 0);

}  // namespace tactus::spm::offline
