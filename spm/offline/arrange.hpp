/// Orders the faces of each record, and the corners of each face, so that records take the fewest bits. The mesh is the
/// same before and after.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Sorts the faces around a vertex counter-clockwise. If they form several fans, sorts one fan after the other. Each
/// entry of `fan` is a face and the number of its corner at the vertex. `corners`: the vertices of each face of the
/// mesh. O(n^2) for n entries.
void order_fan(std::span<DeformedRef> fan, const std::vector<Triangle>& corners);

/// Rotates the corners of every born face so that its corner 0 is the vertex u that its record adds. If a record bears
/// two faces, sorts them: the face in which the parent vertex t is at corner 1 comes first. `parts` as in Model.
/// O(parts); allocates a byte for each face.
void arrange_faces(const ModelSummary& summary, std::span<RecordPart> parts);

}  // namespace tactus::spm::offline
