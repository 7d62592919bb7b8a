/// Cuts polygons into triangles without new vertices.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace tactus::spm::offline {

/// Cuts the polygon with these corners (3 or more, in order) and returns triangles of indices into `corners`. If the
/// polygon is planar and does not cross itself, cuts along inner diagonals. Otherwise the diagonals are arbitrary. The
/// triangles have the orientation of the polygon. Cuts one ear (a triangle of three adjacent corners) at a time: O(n^2)
/// for n corners of which few are concave. Source: Meisters 1975 (every simple polygon has two ears).
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> cut_polygon(const std::vector<std::array<float, 3>>& corners);

}  // namespace tactus::spm::offline
