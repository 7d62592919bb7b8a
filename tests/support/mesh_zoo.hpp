/// Small meshes, each with a property that has broken mesh code before. The name of a mesh states this property.
#pragma once

#include <iosfwd>
#include <string>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::test_support {

struct ZooMesh {
  std::string name;
  spm::offline::TriangleMesh mesh;  ///< before cleaning, like the content of a model file
  bool manifold;                    ///< after cleaning, no edge has more than two faces
};

[[nodiscard]] std::vector<ZooMesh> mesh_zoo();

/// Unit sphere of 20 * 4^subdivisions faces of nearly equal size.
[[nodiscard]] spm::offline::TriangleMesh icosphere(int subdivisions);
/// Grid of `columns` x `rows` unit squares in the plane z = 0, each of two triangles.
[[nodiscard]] spm::offline::TriangleMesh grid_patch(int columns, int rows);

/// Prints only the name, for gtest.
void PrintTo(const ZooMesh& mesh, std::ostream* out);

}  // namespace tactus::test_support
