/// Builds an AB-tree over the triangles of a mesh, without model, records or regions, for tests of queries.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "spm/ab_tree.hpp"
#include "spm/offline/face_order.hpp"
#include "spm/offline/triangle_mesh.hpp"
#include "spm/triangle_pair.hpp"

namespace tactus::test_support {

/// The faces of one mesh with an AB-tree. At first all faces are shown. Faces with odd numbers count as finest faces,
/// faces with even numbers as coarse versions.
class ShownMesh {
 public:
  explicit ShownMesh(const spm::offline::TriangleMesh& mesh)
      : faces_{static_cast<std::uint32_t>(mesh.faces.size())},
        pool_{
            spm::PoolSettings::for_slots(std::max(faces_ / 2 + 1, static_cast<std::uint32_t>(mesh.positions.size())))},
        nodes_{faces_ * 2 + 64},
        tree_{pool_, nodes_, spm::ObjectIndex{1}, faces_} {
    corners_.resize(faces_);
    const std::vector<std::uint32_t> order = spm::offline::face_order(mesh);
    for (std::uint32_t v = 0; v < mesh.positions.size(); ++v)
      pool_.vertices[spm::Slot{v}] = {mesh.positions[v], spm::VertexId{v}};
    for (std::uint32_t f = 0; f < faces_; ++f) {
      const auto& [a, b, c] = mesh.faces[order[f]];
      corners_[f] = {spm::Slot{a}, spm::Slot{b}, spm::Slot{c}};
    }
    show([](std::uint32_t) { return true; });
  }

  /// Shows exactly the faces for whose number `is_shown(number)` is true.
  template <class IsShown>
  void show(const IsShown& is_shown) {
    for (std::uint32_t f = 0; f < faces_; ++f) {
      const spm::RowIndex row{f};
      const bool was_shown = pool_.shown_at[row].is_shown();
      if (is_shown(f) && !was_shown) tree_.insert(row, spm::FaceId{f}, corners_[f], f % 2 == 1);
      if (!is_shown(f) && was_shown) tree_.remove(row);
    }
    tree_.refit();
  }

  [[nodiscard]] const spm::AbTree& tree() const { return tree_; }
  [[nodiscard]] spm::Triangle3d triangle(spm::LeafLane at) const {
    spm::Triangle3d triangle;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::array<float, 3>& p = pool_.vertices[corners_[spm::index(tree_.face(at))][i]].position;
      triangle[i] = {p[0], p[1], p[2]};
    }
    return triangle;
  }

 private:
  std::uint32_t faces_;
  std::vector<std::array<spm::Slot, 3>> corners_;  // by face
  spm::Pool pool_;
  spm::NodePool nodes_;
  spm::AbTree tree_;
};

}  // namespace tactus::test_support
