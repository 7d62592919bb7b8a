/// What a ball meets of a triangle. Model frame, file units.
#pragma once

#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm {

/// A triangle that a ball touches. As small as it can be, since a fold of the surface gives thousands: how deep it is
/// and which way it pushes follow from the ball.
struct alignas(32) Contact {
  Vec3d point;  ///< nearest to the centre
  FaceId face{};
  std::uint32_t node : 31;  ///< of AbTree, where the face is child face % 8
  std::uint32_t last : 1;   ///< finest version

  [[nodiscard]] double depth(const Vec3d& centre, double radius) const noexcept {
    return radius - (centre - point).norm();
  }
};
static_assert(sizeof(Contact) == 32);

}  // namespace tactus::spm
