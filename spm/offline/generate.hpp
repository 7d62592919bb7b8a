/// Generates meshes of any size from a few parameters, for tests, demos and benchmarks: about 0.1 m large, in metres.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

enum class Shape {
  kSphere,   ///< radius 0.05, nearly equal triangles; any even number of faces from 8
  kTorus,    ///< radii 0.05 and 0.02, axis z
  kOrgan,    ///< closed and star-shaped, with bumps and folds in several octaves; as many faces as a sphere
  kTerrain,  ///< 0.1 x 0.1 in x and y, a height field in z with a border
  kWall,     ///< a closed block of 0.1 x 0.1 x 0.02 around the origin with flat sides
  kBox,      ///< edges of 0.1 along the axes, each side a grid
};

/// A stylus, closed and convex: a hemisphere of 3 mm radius around the origin and a round shaft of the same radius, 25
/// mm along +z. 720 triangles, 362 vertices, metres.
[[nodiscard]] TriangleMesh stylus();

/// The names for users: sphere, torus, organ, terrain, wall, box.
[[nodiscard]] std::vector<std::string_view> shape_names();
/// Throws ModelError that lists the shapes.
[[nodiscard]] Shape shape_from_name(std::string_view name);

/// A mesh with about `faces` faces, as near as the shape allows. `seed` changes organ and terrain. Throws ModelError if
/// `faces` is below 8 or at least kMaxFaces.
[[nodiscard]] TriangleMesh generate(Shape shape, std::uint32_t faces, std::uint64_t seed = 1);

}  // namespace tactus::spm::offline
