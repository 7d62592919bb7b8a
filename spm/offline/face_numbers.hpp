#pragma once

#include <span>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Renumbers a model's faces so that the faces of a record have close numbers, whose differences take few bits.
///
/// Tree nodes with at least 64 faces have the same faces as before. Within such a block, two faces that one record
/// bears and that share an edge of the finest mesh stay in one leaf node if possible; this makes leaf boxes a twentieth
/// larger. Within a leaf node, whose order does not matter to the tree, a face follows the face from which its number
/// is coded.
///
/// `mesh`: the finest mesh with its faces in the order of their current ids. O(n).
void number_faces(const TriangleMesh& mesh, const ModelSummary& summary, std::vector<BaseFace>& base_faces,
                  std::span<RecordPart> parts, unsigned threads);

}  // namespace tactus::spm::offline
