/// Applies records to a mesh that is stored by vertex id and face id, and checks every precondition.
///
/// Tests compare the model builder and the forest with this mesh. The mesh does not use spm::for_each_change, so an
/// error in that function cannot occur on both sides of the comparison.
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
  /// Starts as the base mesh. The arrays of `model` must outlive the mesh.
  explicit ReferenceMesh(const spm::Model& model);

  /// Applies the vertex split of `record`. Returns false and changes nothing if the record is already applied, or if a
  /// required vertex or face version is missing. The required version of a face is the version that exists just before
  /// `record` when all records are applied in ascending order.
  [[nodiscard]] bool apply(std::uint32_t record);
  [[nodiscard]] bool applied(std::uint32_t record) const { return active_[model_.summary.base_vertices + record]; }
  /// Applies all records of a region that are not applied yet, in ascending order. Returns false if one of them fails.
  [[nodiscard]] bool apply_region(std::uint32_t region);

  [[nodiscard]] bool shown(std::uint32_t face) const { return shown_[face]; }
  [[nodiscard]] bool finest(std::uint32_t face) const { return shown_[face] && finest_[face]; }
  [[nodiscard]] const std::array<std::uint32_t, 3>& corners(std::uint32_t face) const { return corners_[face]; }

  /// Describes each defect of the present mesh: a shown face with an inactive vertex or with one vertex at two corners,
  /// two shown faces that have the same vertices but not in `finest`, and a face whose normal is 90 degrees or more
  /// from its normal in `finest`. If `manifold`, also an edge with more than two faces.
  [[nodiscard]] std::vector<std::string> defects(const std::vector<std::array<std::uint32_t, 3>>& finest,
                                                 bool manifold) const;

  friend bool operator==(const ReferenceMesh& a, const ReferenceMesh& b) {
    return a.active_ == b.active_ && a.shown_ == b.shown_ && a.finest_ == b.finest_ && a.corners_ == b.corners_;
  }

 private:
  /// The change of one face by a record.
  struct FaceChange {
    std::uint32_t face;
    std::array<std::uint32_t, 3> before, after;  ///< corners; `before` of a born face: kNoCorners
    bool becomes_finest;
  };

  spm::Model model_;
  std::vector<std::vector<FaceChange>> changes_;  // by record
  std::vector<bool> active_, shown_, finest_;
  std::vector<std::array<std::uint32_t, 3>> corners_;
};

/// The bits of the positions of an oriented triangle's corners, beginning with the smallest corner.
using FaceBits = std::array<std::array<std::uint32_t, 3>, 3>;
/// Returns all faces in ascending order. Two meshes with the same faces give equal results for any numbering of
/// vertices and faces.
[[nodiscard]] std::vector<FaceBits> sorted_faces(std::span<const std::array<float, 3>> positions,
                                                 const std::vector<std::array<std::uint32_t, 3>>& faces);

}  // namespace tactus::test_support
