/// Cuts the polygons of a file into triangles without new vertices.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace tactus::spm::offline {

/// Cuts the polygon through `corners` (3 or more, in order) along inner diagonals if it is planar and does not cross
/// itself. Otherwise the diagonals are arbitrary, but orientation and corners are the same. Returns positions in
/// `corners`. Cuts one ear at a time: O(n^2) for n corners of which few are concave. Source: Meisters 1975 (every
/// simple polygon has two ears).
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> cut_polygon(const std::vector<std::array<float, 3>>& corners);

}  // namespace tactus::spm::offline
