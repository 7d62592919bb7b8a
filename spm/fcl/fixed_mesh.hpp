/// A mesh of one fixed resolution in FCL's axis-aligned tree: the baseline of the benchmarks, and a second opinion in
/// tests.
///
/// One frame and unit throughout, the caller's. Allocates in every call, as FCL does; outside the cycle. One thread at
/// a time.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "spm/model.hpp"
#include "spm/span.hpp"

namespace tactus::spm::fcl {

class FixedMesh {
 public:
  using Position = std::array<float, 3>;
  using Face = std::array<std::uint32_t, 3>;

  /// Copies the mesh and builds the tree. Throws std::invalid_argument when there is no face or a corner is not a
  /// vertex.
  FixedMesh(Span<const Position> vertices, Span<const Face> faces);
  ~FixedMesh();
  FixedMesh(FixedMesh&&) noexcept;
  FixedMesh& operator=(FixedMesh&&) noexcept;

  /// Fills `faces` with the indices of all triangles within `radius` of `centre`, in FCL's order. Uses FCL's traversal
  /// as it is, since FCL's plain call copies the whole mesh for this kind of tree.
  void touching(const Vec3d& centre, double radius, std::vector<std::uint32_t>& faces) const;

  /// Fills `pairs` with (triangle of this, triangle of `other`) that intersect, in FCL's order, both meshes as they
  /// stand. FCL finds point, normal and depth of each on the way.
  void intersecting(const FixedMesh& other, std::vector<std::array<std::uint32_t, 2>>& pairs) const;

  /// Distance from `point` to the nearest triangle; 0 on it. FCL squares before it compares: right to about 1e-8 of the
  /// mesh's extent.
  [[nodiscard]] double distance(const Vec3d& point) const;

  /// Takes new positions for the same vertices; refit() or rebuild() must follow before a query. Throws
  /// std::invalid_argument when the count differs.
  void move(Span<const Position> vertices);
  /// Recomputes all boxes, children first, on the tree as it is.
  void refit();
  /// Builds the tree anew.
  void rebuild();

 private:
  struct Tree;
  std::unique_ptr<Tree> tree_;
};

}  // namespace tactus::spm::fcl
