/// Cleans a mesh before simplification: removes duplicates, degenerate faces and unused vertices.
#pragma once

#include <cstdint>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Whether a build may drop most vertices or faces of a mesh.
enum class Losses : std::uint8_t { kRefuse, kAllow };

/// Dropped vertices and faces. Each face counts under the first reason that applies, in this order.
struct CleanReport {
  std::uint32_t welded_vertices = 0;        ///< had the position of an earlier vertex
  std::uint32_t non_finite_faces = 0;       ///< a corner is not finite
  std::uint32_t repeated_corner_faces = 0;  ///< two corners are one vertex
  std::uint32_t zero_area_faces = 0;        ///< corners exactly on one line
  std::uint32_t duplicate_faces = 0;        ///< same corners, same orientation as an earlier face
  std::uint32_t unreferenced_vertices = 0;  ///< used by no remaining face
};

[[nodiscard]] CleanReport operator+(const CleanReport& a, const CleanReport& b);

/// Welds vertices with equal positions (-0 becomes 0), then drops bad faces and unused vertices. The rest has the same
/// order and bits as before. Idempotent. Throws ModelError if a face has a vertex that does not exist. O(n). `threads`:
/// 0: all processors; does not affect the result.
CleanReport clean(TriangleMesh& mesh, unsigned threads = 0);

}  // namespace tactus::spm::offline
