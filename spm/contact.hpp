/// Contacts of a sphere with triangles. Model frame, file units.
#pragma once

#include <cstddef>
#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm {

/// A contact of a sphere with a triangle. A sphere in a fold of the surface has thousands of contacts, so a contact has
/// few bytes: depth and normal are computed from `point` and the sphere when needed.
struct alignas(32) Contact {
  Vec3d point;  ///< point of the triangle that is nearest to the centre
  FaceId face{};
  std::uint32_t node_and_finest = 0;  ///< index of the tree node, and kFinest if the face is in its finest version
  static constexpr int kFinestBit = 31;
  static constexpr std::uint32_t kFinest = 1u << kFinestBit;

  /// The AbTree node of level 1 with the face, which is child face % 8.
  [[nodiscard]] NodeIndex node() const noexcept { return NodeIndex{node_and_finest & ~kFinest}; }
  /// True if the face is in its finest version.
  [[nodiscard]] bool is_finest() const noexcept { return (node_and_finest & kFinest) != 0; }
  [[nodiscard]] double depth(const Vec3d& centre, double radius) const noexcept {
    return radius - (centre - point).norm();
  }
};
static_assert(sizeof(Contact) == 32 && offsetof(Contact, face) == 24 && offsetof(Contact, node_and_finest) == 28,
              "spm/lanes_kernel.inc writes both with one store");

}  // namespace tactus::spm
