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

struct Dependencies {
  std::vector<std::uint32_t> first;  ///< collapse i needs `needs[first[i], first[i + 1])`, each later in the sequence
  std::vector<std::uint32_t> needs;  ///< collapses by their place in the sequence, each once
  std::vector<std::uint16_t> level;  ///< 1 + the highest level needed
  std::uint32_t max_level = 0;

  [[nodiscard]] Span<const std::uint32_t> of(std::uint32_t i) const {
    return {needs.data() + first[i], first[i + 1] - first[i]};
  }
};

/// Throws ModelError when a chain of records is deeper than a level can say.
[[nodiscard]] Dependencies dependencies(const Collapses& collapses, std::size_t vertices);

}  // namespace tactus::spm::offline
