/// A hand that strokes the outside or inside of a sphere, with exact normals, to check the force against the friction
/// law.
#pragma once

#include <cstdint>

#include "haptics/surface.hpp"

namespace tactus::haptics::testing {

/// A sphere of radius `radius` around the origin, touched from outside, or from inside when `hollow`.
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
  std::uint64_t stuck_again = 0;  ///< transitions from slip to stick
  double stick_error = 0;         ///< relative excess of tangential over normal force above the static coefficient
  double slip_error = 0;          ///< greatest relative difference from the dynamic coefficient while the proxy moves
  double max_stuck = 0;           ///< greatest ratio to the static coefficient while sticking
  double max_return = 0;          ///< greatest ratio to the static coefficient at a transition from slip to stick
};

/// `cycles` of strokes that start, stop and change direction, at up to `speed` m/s, 0.2 to 2 mm deep.
[[nodiscard]] FrictionResult run_friction(AnalyticSphere sphere, double static_friction, double dynamic_friction,
                                          double speed, std::uint64_t cycles, std::uint64_t seed);

}  // namespace tactus::haptics::testing
