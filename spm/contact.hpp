/// What a ball meets of a triangle. Model frame, file units.
#pragma once

#include <cstddef>
#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm {

/// A triangle that a ball touches. As small as it can be, since a fold of the surface gives thousands: how deep it is
/// and which way it pushes follow from the ball.
struct alignas(32) Contact {
  Vec3d point;  ///< nearest to the centre
  FaceId face{};
  std::uint32_t place = 0;  ///< node, and kFinest or 0
  static constexpr int kFinestBit = 31;
  static constexpr std::uint32_t kFinest = 1u << kFinestBit;

  /// Of AbTree, where the face is child face % 8.
  [[nodiscard]] std::uint32_t node() const noexcept { return place & ~kFinest; }
  /// It is the face's finest version.
  [[nodiscard]] bool last() const noexcept { return (place & kFinest) != 0; }
  [[nodiscard]] double depth(const Vec3d& centre, double radius) const noexcept {
    return radius - (centre - point).norm();
  }
};
static_assert(sizeof(Contact) == 32 && offsetof(Contact, face) == 24 && offsetof(Contact, place) == 28,
              "spm/lanes_kernel.inc writes them together");

}  // namespace tactus::spm
