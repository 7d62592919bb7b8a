/// Visits the shown faces of an object: the triangles in the leaves of its AB-tree.
///
/// O(shown faces), allocates. One thread at a time, not during a refinement. Not realtime.
#pragma once

#include <vector>

#include "spm/ab_tree.hpp"

namespace tactus::spm {

/// Calls `visit(at, leaf)` for each face, where `at` is its LeafLane and `leaf` the node `at.leaf()`.
template <class Visit>
void for_each_face(const AbTree& tree, Visit visit) {
  std::vector<NodeIndex> stack;
  if (tree.root() != kNone) stack.push_back(tree.root());
  while (!stack.empty()) {
    const NodeIndex at = stack.back();
    const TreeNode& node = tree.node(at);
    stack.pop_back();
    for (unsigned lane = 0; lane < TreeNode::kWidth; ++lane) {
      if ((node.mask >> lane & 1u) == 0) continue;
      if (node.level > 1)
        stack.push_back(node.node(lane));
      else
        visit(LeafLane{at, lane}, node);
    }
  }
}

}  // namespace tactus::spm
