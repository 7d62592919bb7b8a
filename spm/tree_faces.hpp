/// Visits the shown faces of an object: the triangles in the leaves of its AB-tree.
///
/// O(shown faces), allocates. One thread at a time, not during a refinement. Not realtime.
#pragma once

#include <vector>

#include "spm/ab_tree.hpp"

namespace tactus::spm {

/// Calls `visit(node, lane)` for each face, where `node` is a leaf and `lane` is its lane with the face.
template <class Visit>
void for_each_face(const AbTree& tree, Visit visit) {
  std::vector<NodeIndex> stack;
  if (tree.root() != kNone) stack.push_back(tree.root());
  while (!stack.empty()) {
    const TreeNode& node = tree.node(stack.back());
    stack.pop_back();
    for (unsigned lane = 0; lane < TreeNode::kWidth; ++lane) {
      if ((node.mask >> lane & 1u) == 0) continue;
      if (node.level > 1)
        stack.push_back(node.node(lane));
      else
        visit(node, lane);
    }
  }
}

}  // namespace tactus::spm
