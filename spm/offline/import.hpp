/// Imports the triangles of model files that other programs wrote.
#pragma once

#include <filesystem>
#include <set>
#include <string>
#include <string_view>

#include "spm/offline/clean.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Names of files, as paths from the folder of the model.
using FileNames = std::set<std::string>;

/// Reads OBJ, PLY, STL, glTF, GLB and the other formats of assimp. Reads every mesh of the scene with the transforms of
/// the nodes above it, and cuts polygons into triangles. If these transforms are the identity, positions are exactly
/// those of the file, as floats. The result still has the duplicates, degenerate faces and unused vertices of the file,
/// which clean() removes.
///
/// The program tactus-import reads the file, in a process without rights (docs/decisions/0045-confined-import.md). It may
/// read other files of the folder of the model, or below. An import takes some 10 ms more than the reading. Thread: any.
///
/// Throws ModelError that names the file, the value found and the value expected, if the file is missing, empty or
/// damaged, or has no surface (only points, lines or an animation), and if its reader crashes or exceeds a limit
/// (docs/reference/units-and-limits.md). The number of vertices or faces in an OBJ, OFF, PLY or STL file is known before
/// the import. If the import yields less than half of a known number, throws unless `losses` is kAllow. Throws if
/// tactus-import is neither installed nor near the calling program; the variable TACTUS_IMPORT can name it.
///
/// `requested`: if not null, receives the names of all files that the reader has requested besides the model, including
/// those that it did not get. The same model and the same content of these files give the same mesh.
[[nodiscard]] TriangleMesh import_mesh(const std::filesystem::path& path, LossPolicy losses = LossPolicy::kRefuse,
                                       FileNames* requested = nullptr);

/// Opens `model`, if `name` is its file name, or another regular file in its folder or below, for reading. Returns a
/// descriptor, or -1 if there is no such file. Never waits.
[[nodiscard]] int open_requested(const std::filesystem::path& model, std::string_view name);

}  // namespace tactus::spm::offline
