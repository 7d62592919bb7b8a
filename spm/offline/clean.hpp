/// What has to go before a mesh can be simplified: doubles, degenerate faces, vertices that nothing uses.
#pragma once

#include <cstdint>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// What to do when most vertices or faces of a mesh would be dropped on its way from a file to a model.
enum class Losses : std::uint8_t { kRefuse, kAllow };

/// How much was dropped, each face counted under the first reason that applies, in this order.
struct CleanReport {
  std::uint32_t welded_vertices = 0;        ///< had the position of an earlier vertex
  std::uint32_t non_finite_faces = 0;       ///< a corner is not finite
  std::uint32_t repeated_corner_faces = 0;  ///< two corners are one vertex
  std::uint32_t zero_area_faces = 0;        ///< corners exactly on one line
  std::uint32_t duplicate_faces = 0;        ///< same corners, same orientation as an earlier face
  std::uint32_t unreferenced_vertices = 0;  ///< used by no remaining face
};

[[nodiscard]] CleanReport operator+(const CleanReport& a, const CleanReport& b);

/// Welds vertices with equal positions (-0 counts as 0, and becomes it), then drops bad faces and unused vertices. What
/// remains keeps its order and its bits. Cleaning twice changes nothing more. Throws ModelError when a face names a
/// vertex that is not there. O(n). `threads`: 0 is all there are; the result is the same.
CleanReport clean(TriangleMesh& mesh, unsigned threads = 0);

}  // namespace tactus::spm::offline
