#pragma once

#include <vector>

#include "spm/model.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Renumbers a model's faces so that a record's faces have numbers near each other, which then take fewer bits to tell.
/// Nodes of the tree from 64 leaves on hold the same faces as before; below, two faces that one record bears and that
/// share an edge of the finest mesh stay together where they can (leaf nodes grow by a twentieth), and the eight of a
/// leaf node, whose order means nothing to the tree, follow each other as they come from each other.
///
/// `mesh` is the finest mesh, its faces in the order of their ids so far. O(n).
void number_faces(const TriangleMesh& mesh, const ModelSummary& summary, std::vector<BaseFace>& base_faces,
                  Span<RecordPart> parts, unsigned threads);

}  // namespace tactus::spm::offline
