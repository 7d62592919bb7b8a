/// Cleans a mesh before simplification: removes duplicates, degenerate faces and unused vertices.
#pragma once

#include <cstdint>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// States whether a build may drop most vertices or faces of a mesh.
enum class LossPolicy : std::uint8_t { kRefuse, kAllow };

/// Numbers of dropped vertices and faces. If several reasons apply to a face, only the first in this order counts it.
struct CleanReport {
  std::uint32_t welded_vertices = 0;        ///< vertices at the position of an earlier vertex
  std::uint32_t non_finite_faces = 0;       ///< faces with a corner that is not finite
  std::uint32_t repeated_corner_faces = 0;  ///< faces with the same vertex at two corners
  std::uint32_t zero_area_faces = 0;        ///< faces whose corners lie exactly on one line
  std::uint32_t duplicate_faces = 0;        ///< faces with the corners and the orientation of an earlier face
  std::uint32_t unreferenced_vertices = 0;  ///< vertices that no remaining face has
};

[[nodiscard]] CleanReport operator+(const CleanReport& a, const CleanReport& b);

/// Welds vertices with equal positions (-0 becomes 0), and drops bad faces and unused vertices. The remaining vertices
/// and faces have the same order and bits as before. A second call changes nothing. Throws ModelError if a face has a
/// vertex that does not exist. O(n). `threads` (0: one per processor) does not affect the result.
CleanReport clean(TriangleMesh& mesh, unsigned threads = 0);

}  // namespace tactus::spm::offline
