/// Writes meshes as files for other programs.
#pragma once

#include <filesystem>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Writes a .ply or .stl file (binary) or an .obj file (text, with enough digits to restore the floats). No other
/// program sees an incomplete file. If the extension is unknown or the file cannot be written, throws ModelError that
/// names the path; an existing file is then unchanged.
void write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh);

}  // namespace tactus::spm::offline
