/// Reads triangles from the model files of other programs.
#pragma once

#include <filesystem>

#include "spm/offline/clean.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Reads OBJ, PLY, STL, glTF, GLB and the other formats of assimp: all meshes of the scene, placed by their nodes, with
/// polygons cut into triangles. Positions are the bits of the file where no node moves them. Not cleaned.
///
/// Throws ModelError that names the file, the value found and the value expected, if the file is missing, empty or
/// damaged, or has no surface (only points, lines or an animation). Unless `losses` allows it, also throws if most of
/// the vertices or faces that the file declares are missing; OBJ, OFF, PLY and STL declare them.
[[nodiscard]] TriangleMesh import_mesh(const std::filesystem::path& path, Losses losses = Losses::kRefuse);

}  // namespace tactus::spm::offline
