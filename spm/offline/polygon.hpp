/// Polygons of a file, cut into triangles without new vertices.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace tactus::spm::offline {

/// Cuts the polygon through `corners` (3 or more, in order) along diagonals that stay inside where it is planar and
/// does not cross itself; otherwise somehow, still with its orientation and all its corners. Gives positions in
/// `corners`. Ears are cut one by one: O(n^2), for n corners few of which point inward. Source: Meisters 1975 (every
/// simple polygon has two ears).
[[nodiscard]] std::vector<std::array<std::uint32_t, 3>> cut_polygon(const std::vector<std::array<float, 3>>& corners);

}  // namespace tactus::spm::offline
