/// The part of PLY that our reader must not be given unchecked: assimp 5.2 runs forever on a header without an end.
#pragma once

#include <filesystem>

namespace tactus::spm::offline {

/// Throws ModelError naming the file and the line when the header is not PLY, or when it promises more elements than
/// the file has bytes for.
void check_ply_header(const std::filesystem::path& path);

}  // namespace tactus::spm::offline
