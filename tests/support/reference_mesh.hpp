/// Applies a set of records to whole arrays by id and checks every precondition. An oracle for the builder and for the
/// run time, so it does not use spm::for_each_change.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "spm/model.hpp"

namespace tactus::test_support {

class ReferenceMesh {
 public:
  /// Starts as the base mesh. Borrows what the model borrows.
  explicit ReferenceMesh(const spm::Model& model);

  /// Splits; false, with nothing changed, when a vertex or face version that the record needs is not there. Which
  /// versions these are is what it meets when all records are applied in ascending order.
  [[nodiscard]] bool apply(std::uint32_t record);
  [[nodiscard]] bool applied(std::uint32_t record) const { return active_[model_.summary.base_vertices + record]; }
  /// Splits all records of a region that are not applied yet, in ascending order.
  [[nodiscard]] bool apply_region(std::uint32_t region);

  [[nodiscard]] bool shown(std::uint32_t face) const { return shown_[face]; }
  [[nodiscard]] bool finest(std::uint32_t face) const { return shown_[face] && finest_[face]; }
  [[nodiscard]] const std::array<std::uint32_t, 3>& corners(std::uint32_t face) const { return corners_[face]; }

  /// What is wrong with the mesh as it stands, in words: a shown face on a vertex that is not active, with a corner
  /// twice, or there twice; with `manifold`, an edge with more than two faces; against `finest`, a face turned by more
  /// than a right angle.
  [[nodiscard]] std::vector<std::string> defects(const std::vector<std::array<std::uint32_t, 3>>& finest,
                                                 bool manifold) const;

  friend bool operator==(const ReferenceMesh& a, const ReferenceMesh& b) {
    return a.active_ == b.active_ && a.shown_ == b.shown_ && a.finest_ == b.finest_ && a.corners_ == b.corners_;
  }

 private:
  struct Write {
    std::uint32_t face;
    std::array<std::uint32_t, 3> before, after;  ///< `before` is no corners for a face that is born
    bool last;
  };

  spm::Model model_;
  std::vector<std::vector<Write>> writes_;  // by record
  std::vector<bool> active_, shown_, finest_;
  std::vector<std::array<std::uint32_t, 3>> corners_;
};

/// Oriented triangles as bits of their positions, each from its smallest corner, sorted: equal when two meshes have the
/// same faces, however numbered.
using FaceBits = std::array<std::array<std::uint32_t, 3>, 3>;
[[nodiscard]] std::vector<FaceBits> sorted_faces(std::span<const std::array<float, 3>> positions,
                                                 const std::vector<std::array<std::uint32_t, 3>>& faces);

}  // namespace tactus::test_support
