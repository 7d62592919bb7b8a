/// Plain triangle files, for other programs to read.
#pragma once

#include <filesystem>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// By extension: .ply and .stl binary, .obj text with digits enough to give the same floats back. Throws ModelError
/// naming the path when the extension is another or the file cannot be written; what was there under the name stays
/// then, and nothing half written is ever seen under it.
void write_mesh(const std::filesystem::path& path, const TriangleMesh& mesh);

}  // namespace tactus::spm::offline
