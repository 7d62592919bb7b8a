/// Meshes of any size made from a few numbers, for tests, demos and benchmarks: about 0.1 m in size, in metres.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

enum class Shape {
  kSphere,   ///< radius 0.05, nearly even triangles; any even number of faces from 8
  kTorus,    ///< radii 0.05 and 0.02, axis z
  kOrgan,    ///< closed and star-shaped, with bumps and folds in several octaves; as many faces as a sphere
  kTerrain,  ///< 0.1 x 0.1 in x and y, a height field in z with a border
  kWall,     ///< a closed block of 0.1 x 0.1 x 0.02 about the origin; its sides are as flat as floats allow
  kBox,      ///< edges of 0.1 along the axes, each side a grid
};

/// A stylus to probe with, closed and convex: half a ball of 3 mm radius about the origin, and from there a round shaft
/// of the same radius, 25 mm along +z. 720 triangles, 362 vertices, metres.
[[nodiscard]] TriangleMesh stylus();

/// The names a user types: sphere, torus, organ, terrain, wall, box.
[[nodiscard]] std::vector<std::string_view> shape_names();
/// Throws ModelError naming the shapes there are.
[[nodiscard]] Shape shape_from_name(std::string_view name);

/// As near to `faces` faces as the shape allows. `seed` changes organ and terrain. Throws ModelError when `faces` is
/// below 8 or at least kMaxFaces.
[[nodiscard]] TriangleMesh generate(Shape shape, std::uint32_t faces, std::uint64_t seed = 1);

}  // namespace tactus::spm::offline
