/// Small meshes, each with something that has broken mesh code before; the name says what.
#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::test_support {

struct ZooMesh {
  std::string name;
  spm::offline::TriangleMesh mesh;  ///< as a file might have it: not cleaned
  bool manifold;                    ///< no edge has more than two faces, once cleaned
};

[[nodiscard]] std::vector<ZooMesh> mesh_zoo();

/// Unit sphere of 20 * 4^subdivisions nearly even faces.
[[nodiscard]] spm::offline::TriangleMesh icosphere(int subdivisions);
/// `columns` x `rows` quads, each of two triangles, in the plane z = 0, with unit spacing.
[[nodiscard]] spm::offline::TriangleMesh grid_patch(int columns, int rows);

/// For gtest: the name alone.
void PrintTo(const ZooMesh& mesh, std::ostream* out);

}  // namespace tactus::test_support
