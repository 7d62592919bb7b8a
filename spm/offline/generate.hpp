/// Generates meshes with any number of faces, for tests, demos and benchmarks. The meshes are about 0.1 m large; unit:
/// metres.
#pragma once

#include <cstdint>
#include <string_view>
#include <vector>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

enum class Shape {
  kSphere,   ///< radius 0.05 m, nearly equal triangles; any even number of faces from 8
  kTorus,    ///< radii 0.05 m and 0.02 m, axis z
  kOrgan,    ///< closed and star-shaped, with bumps and folds in several octaves; any even number of faces from 8
  kTerrain,  ///< height field in z with a border, 0.1 m x 0.1 m in x and y
  kWall,     ///< closed block of 0.1 m x 0.1 m x 0.02 m around the origin, with flat sides
  kBox,      ///< cube with edges of 0.1 m along the axes; each side is a grid
};

/// Generates a stylus, closed and convex: a hemisphere of 3 mm radius around the origin, and a round shaft of the same
/// radius and 25 mm length along +z. It has 720 triangles and 362 vertices; unit: metres.
[[nodiscard]] TriangleMesh stylus();

/// The names of the shapes for users: sphere, torus, organ, terrain, wall, box.
[[nodiscard]] std::vector<std::string_view> shape_names();
/// Throws ModelError that lists the names if there is no such shape.
[[nodiscard]] Shape shape_from_name(std::string_view name);

/// Generates a mesh with about `faces` faces. Sphere and organ have exactly this number if it is even, else one less.
/// `seed` affects organ and terrain only. Throws ModelError if `faces` is below 8 or at least kMaxBuiltFaces.
[[nodiscard]] TriangleMesh generate(Shape shape, std::uint32_t faces, std::uint64_t seed = 1);

}  // namespace tactus::spm::offline
