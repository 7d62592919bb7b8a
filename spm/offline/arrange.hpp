/// Orders the faces of records and their corners so that records take the fewest bits. The mesh is unchanged.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Sorts faces around one vertex counter-clockwise, one fan after the other. `corners`: by face; the vertex is at the
/// corner of each DeformedRef. O(n^2).
void order_fan(std::span<DeformedRef> fan, const std::vector<Triangle>& corners);

/// Rotates the corners of every face so that u is at corner 0 when the face is born, and sorts the born faces: first
/// the one at the first end of the fan. `parts` as in Model. O(parts), a byte for each face.
void arrange_faces(const ModelSummary& summary, std::span<RecordPart> parts);

}  // namespace tactus::spm::offline
