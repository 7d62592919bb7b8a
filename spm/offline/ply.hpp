/// PLY files: polygons and triangle strips, ASCII and binary in both byte orders.
///
/// assimp 5.2 runs forever on a header without an end and makes one triangle of a file of strips, so PLY has a reader
/// of its own. Format: G. Turk, "The PLY Polygon File Format", 1994.
#pragma once

#include <cstddef>
#include <filesystem>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// All faces of a PLY file, polygons cut into triangles; positions to the bit as the file has them, rounded to float
/// when they are doubles.
struct PlyMesh {
  TriangleMesh mesh;
  std::size_t polygons = 0;  ///< faces before they are cut, triangles of strips among them
  std::size_t lines = 0;     ///< faces with fewer than three corners, which are left out
};

/// Reads the elements `vertex`, `face` (lists `vertex_indices` or `vertex_index`) and `tristrips` (lists of strips that
/// -1 separates, with alternating winding; corners that a strip repeats make no triangle). Skips all other elements and
/// properties. Throws ModelError that names the file and what was found when the file is damaged, is truncated, or
/// names a vertex that it lacks. Memory grows with what the file holds, never with what its header promises.
[[nodiscard]] PlyMesh read_ply(const std::filesystem::path& path);

}  // namespace tactus::spm::offline
