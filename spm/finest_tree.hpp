/// An AB-tree of the whole finest mesh. It offers the queries of an HRTC without a forest.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/ab_tree.hpp"

namespace tactus::spm {

/// Returns the corners of a shown face in double.
[[nodiscard]] inline std::array<Vec3d, 3> shown_corners(const AbTree& tree, LeafLane at) {
  const std::array<float, 9> c = tree.corners(at);
  return {Vec3d{c[0], c[1], c[2]}, Vec3d{c[3], c[4], c[5]}, Vec3d{c[6], c[7], c[8]}};
}

class FinestTree {
 public:
  /// `faces` is sorted by FaceId.
  FinestTree(std::span<const std::array<float, 3>> positions, std::span<const std::array<std::uint32_t, 3>> faces)
      : pool_{{static_cast<std::uint32_t>(std::max(faces.size() / 2 + 1, positions.size())), 1, 1}},
        nodes_{static_cast<std::uint32_t>(faces.size()) / 6 + 64},
        tree_{pool_, nodes_, ObjectIndex{}, static_cast<std::uint32_t>(faces.size())} {
    for (std::uint32_t v = 0; v < positions.size(); ++v) pool_.vertices[Slot{v}] = {positions[v], VertexId{v}};
    for (std::uint32_t f = 0; f < faces.size(); ++f) {
      const auto& [a, b, c] = faces[f];
      tree_.insert(RowIndex{f}, FaceId{f}, {Slot{a}, Slot{b}, Slot{c}}, true);
    }
    tree_.refit();
  }
  [[nodiscard]] const AbTree& tree() const noexcept { return tree_; }

 private:
  Pool pool_;
  NodePool nodes_;
  AbTree tree_;
};

}  // namespace tactus::spm
