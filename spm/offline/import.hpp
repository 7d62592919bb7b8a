/// Triangles from the model files that other programs write.
#pragma once

#include <filesystem>

#include "spm/offline/clean.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Reads OBJ, PLY, STL, glTF, GLB and whatever else assimp knows: all meshes of the scene, placed by their nodes,
/// polygons cut into triangles, positions to the bit as the file has them where no node moves them. Not cleaned. Throws
/// ModelError naming the file, what was found and what was expected: when it is missing, empty or damaged, or holds no
/// surface (points, lines, an animation alone). Unless `losses` allows it, also when most of the vertices or faces that
/// the file declares would be missing; counts are known of OBJ, OFF, PLY and STL.
[[nodiscard]] TriangleMesh import_mesh(const std::filesystem::path& path, Losses losses = Losses::kRefuse);

}  // namespace tactus::spm::offline
