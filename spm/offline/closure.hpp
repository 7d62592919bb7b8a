/// Finds the dependencies of records: the records that must be applied before a record, so that every closed set is a
/// valid mesh.
///
/// A record needs (a) for each face that it deforms, the record that made the previous version of the face, and (b) for
/// each corner of a face that it bears or deforms, the record that adds the vertex at this corner. Rule (a) alone is
/// not enough at borders: a record that bears one face and deforms none still needs the vertices of that face.
/// Source: De Floriani, Magillo, Puppo 1997 (a closed set of a Multi-Triangulation is a mesh).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "spm/offline/simplify.hpp"

namespace tactus::spm::offline {

/// The dependencies of the records that undo the collapses. A record has the number of its collapse; the collapses of
/// all segments are numbered as one sequence. A record needs only records of later collapses.
struct Dependencies {
  std::vector<std::uint32_t> segment;     ///< first collapse of each segment; last: number of collapses
  std::vector<std::uint32_t> removed_by;  ///< collapse that removes the vertex, by vertex; kNone in the base mesh
  std::vector<std::uint32_t> first;       ///< first index of record i in `needs`; the index of record i + 1 is its end
  std::vector<std::uint32_t> needs;       ///< the needs of record 0, ascending; then those of record 1, and so on
  std::vector<std::uint16_t> level;       ///< 1 + highest level of a needed record; 1 if it needs none
  std::uint32_t max_level = 0;

  /// Number of collapses.
  [[nodiscard]] std::uint32_t size() const noexcept { return segment.back(); }
  /// The records that record i needs.
  [[nodiscard]] std::span<const std::uint32_t> of(std::uint32_t i) const {
    return {needs.data() + first[i], first[i + 1] - first[i]};
  }
};

/// Finds all dependencies. Sets the numbers of the moved corners of each collapse, and sorts these by order_fan(). Sets
/// `collapses.corners` to the finest mesh, in which corner 0 of a face that a collapse has removed is the vertex u of
/// that collapse. Throws ModelError if a record has a level above 65535. `threads`: 0: one per processor.
[[nodiscard]] Dependencies dependencies(Collapses& collapses, std::size_t vertices, unsigned threads = 0);

}  // namespace tactus::spm::offline
