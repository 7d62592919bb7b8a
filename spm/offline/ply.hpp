/// Reads PLY files: polygons and triangle strips, ASCII and binary in both byte orders.
///
/// assimp 5.2 never returns for a header without an end, and makes one triangle of a file of strips. So PLY has its own
/// reader. Format: G. Turk, "The PLY Polygon File Format", 1994.
#pragma once

#include <cstddef>
#include <filesystem>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// All faces of a PLY file, with polygons cut into triangles. Positions have the bits of the file; doubles are rounded
/// to float.
struct PlyMesh {
  TriangleMesh mesh;
  std::size_t polygons = 0;  ///< faces before they are cut, with the triangles of strips
  std::size_t lines = 0;     ///< faces with fewer than three corners, which are left out
};

/// Reads the elements `vertex`, `face` (lists `vertex_indices` or `vertex_index`) and `tristrips` (lists of strips with
/// alternating winding, separated by -1; repeated corners give no triangle). Skips all other elements and properties.
/// Throws ModelError that names the file and the error if the file is damaged or truncated, or a face has a vertex that
/// does not exist. Memory is bounded by the size of the file, whatever its header declares.
[[nodiscard]] PlyMesh read_ply(const std::filesystem::path& path);

}  // namespace tactus::spm::offline
