#pragma once

#include <span>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

/// Renumbers the faces of a model so that the faces of a record have close numbers, whose differences take few bits.
///
/// Tree nodes with 64 faces or more have the same faces before and after. Within a block of 64 faces, two faces that
/// one record bears and that share an edge of the finest mesh are put into one leaf of the tree if possible. This makes
/// the boxes of leaves 5 % larger. The number of most faces is coded as the difference to the number of another face.
/// Within a leaf, a face therefore comes after this other face. The tree allows any order of the faces of a leaf.
///
/// `mesh`: the finest mesh, with its faces in the order of their current ids. O(n).
void number_faces(const TriangleMesh& mesh, const ModelSummary& summary, std::vector<BaseFace>& base_faces,
                  std::span<RecordPart> parts, unsigned threads);

}  // namespace tactus::spm::offline
