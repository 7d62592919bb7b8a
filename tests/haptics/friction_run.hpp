/// Simulates a hand that strokes the outside or the inside of an exact sphere, to compare the force with the friction
/// law.
#pragma once

#include <cstdint>

#include "haptics/surface.hpp"

namespace tactus::haptics::testing {

/// A sphere around the origin, which the tip touches from outside, or from inside if `hollow`.
class AnalyticSphere final : public Surface {
 public:
  AnalyticSphere(double radius, bool hollow) : radius_{radius}, hollow_{hollow} {}
  [[nodiscard]] double radius() const { return radius_; }
  [[nodiscard]] bool hollow() const { return hollow_; }
  /// Normal of the surface point that is closest to `x`, towards the side of the tip.
  [[nodiscard]] Vec3d normal(const Vec3d& x) const { return (hollow_ ? -x : x).normalized(); }

  [[nodiscard]] bool sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept override;
  [[nodiscard]] bool closest(const Vec3d& point, double max_distance, SurfaceHit& hit) const noexcept override;

 private:
  double radius_;
  bool hollow_;
};

/// The force ratio is the tangential force divided by the normal force.
struct FrictionResult {
  std::uint64_t sticking = 0, slipping = 0;  ///< cycles
  std::uint64_t stuck_again = 0;             ///< transitions from slip to stick
  double stick_error = 0;                    ///< maximum of force ratio / static coefficient - 1 while the proxy sticks
  double slip_error = 0;  ///< maximum of |force ratio / dynamic coefficient - 1| while the proxy moves
  double max_stuck = 0;   ///< maximum of force ratio / static coefficient while the proxy sticks
  double max_return = 0;  ///< maximum of force ratio / static coefficient at a transition from slip to stick
};

/// Simulates `cycles` cycles of a hand that starts, stops and changes direction, 0.2 to 2 mm below the surface.
/// `max_speed`: m/s.
[[nodiscard]] FrictionResult run_friction(AnalyticSphere sphere, double static_friction, double dynamic_friction,
                                          double max_speed, std::uint64_t cycles, std::uint64_t seed);

}  // namespace tactus::haptics::testing
