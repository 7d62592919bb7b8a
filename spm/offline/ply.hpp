/// Reads PLY files: polygons and triangle strips, ASCII and binary in both byte orders.
///
/// We do not use the PLY reader of assimp 5.2: it never returns if a header has no end, and it reads only one triangle
/// from a file of triangle strips. Format: G. Turk, "The PLY Polygon File Format", 1994.
#pragma once

#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <string>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// All faces of a PLY file, with polygons cut into triangles. Positions have the bits of the file; doubles are rounded
/// to float.
struct PlyMesh {
  TriangleMesh mesh;
  std::size_t polygons = 0;  ///< number of faces before polygons are cut; counts each triangle of a strip
  std::size_t lines = 0;     ///< number of faces with fewer than three corners, which `mesh` does not have
};

struct PlyFile {
  std::string name;         ///< for messages
  std::uint64_t bytes = 0;  ///< size of the file
};

/// Reads the elements `vertex`, `face` and `tristrips`, with their lists `vertex_indices` or `vertex_index`, and skips
/// all other elements and properties. In a list of `tristrips`, -1 separates strips, the winding alternates, and a
/// repeated corner makes no triangle. Throws ModelError that names file and error if the file is damaged or truncated,
/// or if a face has a vertex that does not exist. The size of the file bounds the memory, whatever the header declares.
/// `bytes`: the whole file, at its beginning.
[[nodiscard]] PlyMesh read_ply(const PlyFile& file, std::istream& bytes);

}  // namespace tactus::spm::offline
