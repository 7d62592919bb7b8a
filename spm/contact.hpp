/// A contact of a sphere with a triangle. Model frame, file units.
#pragma once

#include <cstddef>
#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm {

/// A triangle that a sphere touches. A fold of the surface gives thousands of contacts, so they are small: depth and
/// normal follow from the sphere.
struct alignas(32) Contact {
  Vec3d point;  ///< of the triangle, nearest to the centre
  FaceId face{};
  std::uint32_t place = 0;  ///< node, and kFinest or 0
  static constexpr int kFinestBit = 31;
  static constexpr std::uint32_t kFinest = 1u << kFinestBit;

  /// The AbTree node in which the face is child face % 8.
  [[nodiscard]] NodeIndex node() const noexcept { return NodeIndex{place & ~kFinest}; }
  /// True if this is the finest version of the face.
  [[nodiscard]] bool last() const noexcept { return (place & kFinest) != 0; }
  [[nodiscard]] double depth(const Vec3d& centre, double radius) const noexcept {
    return radius - (centre - point).norm();
  }
};
static_assert(sizeof(Contact) == 32 && offsetof(Contact, face) == 24 && offsetof(Contact, place) == 28,
              "spm/lanes_kernel.inc writes them together");

}  // namespace tactus::spm
