/// Reads triangles from the model files of other programs.
#pragma once

#include <filesystem>

#include "spm/offline/clean.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Reads OBJ, PLY, STL, glTF, GLB and the other formats of assimp. Reads all meshes of the scene, transforms them by
/// their nodes, and cuts polygons into triangles. A position that no node transforms has the bits of the file. The
/// result is not cleaned.
///
/// Throws ModelError that names the file, the value found and the value expected, if the file is missing, empty or
/// damaged, or has no surface (only points, lines or an animation). OBJ, OFF, PLY and STL files declare how many
/// vertices or faces they have. If most of them are missing, throws unless `losses` allows it.
[[nodiscard]] TriangleMesh import_mesh(const std::filesystem::path& path, Losses losses = Losses::kRefuse);

}  // namespace tactus::spm::offline
