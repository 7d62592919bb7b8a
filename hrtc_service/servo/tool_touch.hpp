/// Moves a tool, computes its force on the hand, and covers it with spheres for refinement and query.
///
/// The smoothed velocity of the tool predicts the motion of the spheres. World frame, SI. Haptic thread. Realtime after
/// construction.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "haptics/tool.hpp"
#include "hrtc_service/servo/probe.hpp"
#include "spm/probe_spheres.hpp"

namespace tactus::hrtc_service {

/// Returns the shape within which the mesh must be the finest for exact contacts, m: the tool enlarged by its collision
/// margin, or a tip of that radius if `tool` is null. Loader and cycle use the same shape.
[[nodiscard]] spm::ProbeShape shape_of_probe(const spm::MeshProbe* tool, double radius);

class ToolTouch {
 public:
  /// `probe`: mesh of the tool in metres; must outlive this object. Allocates.
  explicit ToolTouch(const spm::MeshProbe& probe);

  /// Resets the tool. The next step starts at the device.
  void reset() noexcept;

  /// Moves the tool towards `goal`, as far as the objects of the step permit.
  void move_to(const ProbeStep& step, const haptics::ToolPose& goal) noexcept;
  /// Moves the tool towards the device and computes the force.
  const haptics::ForceResult& render(const ProbeStep& step) noexcept;

  /// Returns the point to which the device is coupled: the origin of the tool.
  [[nodiscard]] const Vec3d& coupling_point() const noexcept { return tool_.last().pose.position; }
  [[nodiscard]] const haptics::ToolResult& last() const noexcept { return tool_.last(); }
  /// Returns spheres that cover the tool at its pose, enlarged by the collision margin. `out` is their storage.
  using Spheres = std::array<TouchSphere, spm::ProbeShape::kMaxSpheres>;
  [[nodiscard]] std::span<const TouchSphere> spheres(Spheres& out) const noexcept;
  [[nodiscard]] haptics::Tool& tool() noexcept { return tool_; }

  /// As Cycle::for_each_carried.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    tool_.for_each_carried(visit);
    visit.any("objects near a tool", objects_before_);
    visit.number("velocity of a tool", velocity_), visit.number("angular velocity of a tool", angular_velocity_);
  }

 private:
  [[nodiscard]] haptics::ContactImpedance impedance_of(const ProbeStep& step) const noexcept;

  haptics::Tool tool_;
  spm::ProbeShape shape_;
  std::array<haptics::ToolObject, kMaxObjects> objects_;
  std::uint64_t objects_before_ = 0;                                   // objects of the last step, by index bit
  Vec3d velocity_ = Vec3d::Zero(), angular_velocity_ = Vec3d::Zero();  // of the tool, smoothed
};

}  // namespace tactus::hrtc_service
