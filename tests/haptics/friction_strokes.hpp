/// A hand that strokes a ball, or a ball's hollow, whose normals are known exactly: is the force where friction says?
#pragma once

#include <cstdint>

#include "haptics/surface.hpp"

namespace tactus::haptics::testing {

/// A ball of radius `radius` around the origin, felt from outside, or from within when `hollow`.
class AnalyticSphere final : public Surface {
 public:
  AnalyticSphere(double radius, bool hollow) : radius_{radius}, hollow_{hollow} {}
  [[nodiscard]] double radius() const { return radius_; }
  [[nodiscard]] bool hollow() const { return hollow_; }
  /// Outer normal at the surface below `x`.
  [[nodiscard]] Vec3d normal(const Vec3d& x) const { return (hollow_ ? -x : x).normalized(); }

  [[nodiscard]] bool sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept override;
  [[nodiscard]] bool closest(const Vec3d& point, double within, SurfaceHit& hit) const noexcept override;

 private:
  double radius_;
  bool hollow_;
};

struct FrictionResult {
  std::uint64_t sticking = 0, slipping = 0;
  std::uint64_t stuck_again = 0;  ///< times that it stuck after it had slipped
  double stick_error = 0;         ///< share by which tangential force over normal force exceeds the static coefficient
  double slip_error = 0;          ///< share by which it differs from the dynamic one while the proxy moves, at most
  double max_stuck = 0;           ///< ratio to the static coefficient at which it stuck, at most
  double max_return = 0;          ///< ratio to the static coefficient at which it stuck again, at most
};

/// `cycles` of strokes that start, stop and turn, up to `speed` in m/s, 0.2 to 2 mm deep.
[[nodiscard]] FrictionResult motion_segment(AnalyticSphere sphere, double static_friction, double dynamic_friction,
                                            double speed, std::uint64_t cycles, std::uint64_t seed);

}  // namespace tactus::haptics::testing
