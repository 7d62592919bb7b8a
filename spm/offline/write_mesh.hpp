/// Writes triangle files for other programs.
#pragma once

#include <filesystem>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// The extension selects the format: .ply and .stl are binary, .obj is text with enough digits to restore the floats.
/// Throws ModelError that names the path if the extension is unknown or the file cannot be written. An existing file
/// then remains, and no other program sees an incomplete file.
void write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh);

}  // namespace tactus::spm::offline
