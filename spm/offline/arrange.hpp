/// Puts what a record says of its faces into the form that takes the fewest bits to send; the mesh stays what it is.
#pragma once

#include <cstdint>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/triangle_mesh.hpp"
#include "spm/span.hpp"

namespace tactus::spm::offline {

/// Lists faces around one vertex as they follow each other counter-clockwise from one end to the other; where there are
/// several fans, one after another. `corners` by face, the vertex at the corner given. O(n^2).
void order_fan(Span<DeformedRef> fan, const std::vector<Triangle>& corners);

/// Turns every face so that its own vertex is at corner 0 when it is born, and puts the face born at the first end of
/// a record's fan before that at the last. `parts` as in Model. O(parts), a byte a face.
void arrange_faces(const ModelSummary& summary, Span<RecordPart> parts);

}  // namespace tactus::spm::offline
