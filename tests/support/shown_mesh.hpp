/// Any triangles under an AB-tree, without a model, records or regions: for tests of queries.
#pragma once

#include <cstdint>
#include <vector>

#include "spm/ab_tree.hpp"
#include "spm/offline/face_order.hpp"
#include "spm/offline/triangle_mesh.hpp"
#include "spm/triangle_pair.hpp"

namespace tactus::test_support {

/// Faces of a mesh in a tree of their own; at first all are shown. Every second one passes for a coarse version.
class ShownMesh {
 public:
  explicit ShownMesh(const spm::offline::TriangleMesh& mesh)
      : faces_{static_cast<std::uint32_t>(mesh.faces.size())},
        pool_{spm::PoolSettings::for_slots(faces_ / 2 + 1)},
        nodes_{faces_ * 2 + 64},
        tree_{pool_, nodes_, 1, faces_} {
    const std::vector<std::uint32_t> order = spm::offline::face_order(mesh);
    for (std::uint32_t f = 0; f < faces_; ++f) {
      spm::FaceRow& row = pool_.faces[f];
      for (int i = 0; i < 9; ++i) row.corners[i] = mesh.positions[mesh.faces[order[f]][i / 3]][i % 3];
      row.face = f;
      row.node = spm::kNone;
      row.last = f % 2;
    }
    show([](std::uint32_t) { return true; });
  }

  /// Shows just the faces of which `wanted(FaceId as a number)` is true.
  template <class Wanted>
  void show(const Wanted& wanted) {
    for (std::uint32_t f = 0; f < faces_; ++f) {
      const bool shown = pool_.faces[f].node != spm::kNone;
      if (wanted(f) && !shown) tree_.insert(f);
      if (!wanted(f) && shown) tree_.remove(f);
    }
    tree_.refit();
  }

  [[nodiscard]] const spm::AbTree& tree() const { return tree_; }
  [[nodiscard]] spm::Triangle3d triangle(std::uint32_t row) const {
    const std::array<float, 9>& c = pool_.faces[row].corners;
    return {spm::Vec3d{c[0], c[1], c[2]}, spm::Vec3d{c[3], c[4], c[5]}, spm::Vec3d{c[6], c[7], c[8]}};
  }

 private:
  std::uint32_t faces_;
  spm::Pool pool_;
  spm::NodePool nodes_;
  spm::AbTree tree_;
};

}  // namespace tactus::test_support
