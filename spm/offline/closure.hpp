/// Which records a record needs before it, so that every closed set of records is one valid mesh in any order.
///
/// Record i needs (a) for each face that it deforms, the record that produces the version it starts from, and (b) the
/// records of t and of all other corners of the faces it produces. Rule (a) alone leaves ears at borders open: an ear
/// deforms nothing, yet stands on vertices that must be there.
/// Sources: De Floriani, Magillo, Puppo 1997 (a closed set of a Multi-Triangulation is a mesh).
#pragma once

#include <cstdint>
#include <vector>

#include "spm/offline/simplify.hpp"
#include "spm/span.hpp"

namespace tactus::spm::offline {

/// Collapses are numbered as if all segments were one sequence.
struct Dependencies {
  std::vector<std::uint32_t> segment;     ///< the first collapse of each segment, and the number of collapses
  std::vector<std::uint32_t> removed_by;  ///< by vertex: the collapse that takes it away; kNone in the base mesh
  std::vector<std::uint32_t> first;  ///< collapse i needs `needs[first[i], first[i + 1])`, each later in the sequence
  std::vector<std::uint32_t> needs;  ///< each once, ascending
  std::vector<std::uint16_t> level;  ///< 1 + the highest level needed
  std::uint32_t max_level = 0;

  [[nodiscard]] std::uint32_t size() const noexcept { return segment.back(); }
  [[nodiscard]] Span<const std::uint32_t> of(std::uint32_t i) const {
    return {needs.data() + first[i], first[i + 1] - first[i]};
  }
};

/// Leaves in `collapses.corners` the finest mesh, and the moved corners of each collapse in the order of order_fan().
/// Throws ModelError when a chain of records is deeper than a level can
/// say.
[[nodiscard]] Dependencies dependencies(Collapses& collapses, std::size_t vertices, unsigned threads = 0);

}  // namespace tactus::spm::offline
