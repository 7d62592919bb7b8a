/// Writes a triangle mesh as a GLB file, the binary form of glTF 2.0 (specification of the Khronos Group).
///
///     "glTF" | 2 | bytes of the file | JSON chunk, filled up by blanks | BIN chunk: positions, normals, indices
///
/// In glTF the y axis points up, in a session the z axis. The node of the mesh therefore has a rotation, and the
/// positions are unchanged.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace tactus::trace {

/// Returns the file. The normal of a vertex is the mean of the normals of its triangles, weighted by their areas.
/// `color`: red, green, blue, each from 0 to 1. Corners of `triangles` are below the number of `positions`, and
/// positions are finite. A mesh without vertices or triangles becomes a file with an empty scene.
[[nodiscard]] std::vector<std::uint8_t> to_glb(std::span<const std::array<float, 3>> positions,
                                               std::span<const std::array<std::uint32_t, 3>> triangles,
                                               const std::array<float, 3>& color);

}  // namespace tactus::trace
