/// Answers queries on a mesh of fixed resolution with FCL's tree of axis-aligned boxes. Benchmarks compare with it, and
/// tests use it as an independent check.
///
/// All arguments and results are in the caller's frame and unit. Every call allocates, because FCL does, so the cycle
/// must not use this class. One thread at a time.
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

  /// Sets `faces` to the indices of all triangles within `radius` of `centre`, in FCL's order. Calls FCL's traversal
  /// directly: for a tree of axis-aligned boxes, FCL's collide() copies the whole mesh.
  void find_touched_faces(const Vec3d& centre, double radius, std::vector<std::uint32_t>& faces) const;

  /// Sets `pairs` to the intersecting pairs (triangle of this mesh, triangle of `other`), in FCL's order. FCL also
  /// computes point, normal and depth of each pair, which costs time.
  void intersecting(const FixedMesh& other, std::vector<std::array<std::uint32_t, 2>>& pairs) const;

  /// Returns the distance from `point` to the nearest triangle. FCL compares squared distances, so the error is up to
  /// about 1e-8 of the mesh's extent.
  [[nodiscard]] double distance(const Vec3d& point) const;

  /// Sets new positions of the vertices. Call refit() or rebuild() before the next query. Throws std::invalid_argument
  /// if the number of vertices differs.
  void move(std::span<const Position> vertices);
  /// Recomputes all boxes, children first. Each node has the same triangles as before.
  void refit();
  /// Builds the tree anew.
  void rebuild();

 private:
  struct Tree;
  std::unique_ptr<Tree> tree_;
};

}  // namespace tactus::spm::fcl
