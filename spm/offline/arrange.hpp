/// Orders the faces of each record so that records take the fewest bits. The mesh is the same before and after.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "spm/offline/simplify.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Sorts the faces around a vertex counter-clockwise. If they form several fans, sorts one fan after the other. Each
/// entry of `fan` is a face and the number of its corner at the vertex. `corners`: the vertices of each face of the
/// mesh. O(n^2) for n entries.
void order_fan(std::span<MovedCorner> fan, const std::vector<Triangle>& corners);

}  // namespace tactus::spm::offline
