/// A mesh of fixed resolution in FCL's tree of axis-aligned boxes: a baseline for benchmarks and an independent oracle
/// for tests.
///
/// The caller's frame and unit throughout. Every call allocates, because FCL does; outside the cycle. One thread at a
/// time.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "spm/model.hpp"

namespace tactus::spm::fcl {

class FixedMesh {
 public:
  using Position = std::array<float, 3>;
  using Face = std::array<std::uint32_t, 3>;

  /// Copies the mesh and builds the tree. Throws std::invalid_argument if there is no face or a corner is not a vertex.
  FixedMesh(std::span<const Position> vertices, std::span<const Face> faces);
  ~FixedMesh();
  FixedMesh(FixedMesh&&) noexcept;
  FixedMesh& operator=(FixedMesh&&) noexcept;

  /// Sets `faces` to the indices of all triangles within `radius` of `centre`, in FCL's order. Uses FCL's traversal
  /// directly, because FCL's plain call copies the whole mesh for this kind of tree.
  void touching(const Vec3d& centre, double radius, std::vector<std::uint32_t>& faces) const;

  /// Sets `pairs` to the intersecting pairs (triangle of this, triangle of `other`), in FCL's order. FCL also computes
  /// point, normal and depth of each pair.
  void intersecting(const FixedMesh& other, std::vector<std::array<std::uint32_t, 2>>& pairs) const;

  /// Distance from `point` to the nearest triangle; 0 on it. FCL squares before it compares: right to about 1e-8 of the
  /// mesh's extent.
  [[nodiscard]] double distance(const Vec3d& point) const;

  /// Sets new positions for the same vertices. Call refit() or rebuild() before the next query. Throws
  /// std::invalid_argument if the count differs.
  void move(std::span<const Position> vertices);
  /// Recomputes all boxes, children first; the tree is unchanged.
  void refit();
  /// Builds the tree again.
  void rebuild();

 private:
  struct Tree;
  std::unique_ptr<Tree> tree_;
};

}  // namespace tactus::spm::fcl
