/// A probe that holds a tool: the tool, its force on the hand, and the spheres that cover it for refinement and query.
///
/// The smoothed velocity of the tool predicts the motion of the spheres. World frame, SI. The haptic thread's. Realtime
/// after construction.
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "haptics/tool.hpp"
#include "hrtc_service/probe.hpp"
#include "spm/probe_spheres.hpp"

namespace tactus::hrtc_service {

/// The shape within which the mesh must be the finest one for exact contacts: the tool enlarged by its collision
/// margin, or, when `tool` is null, a tip of that radius. m. Loader and cycle use the same shape.
[[nodiscard]] spm::ProbeShape shape_of_probe(const spm::MeshProbe* tool, double radius);

class ToolTouch {
 public:
  /// `probe` in metres; must outlive it. Allocates.
  explicit ToolTouch(const spm::MeshProbe& probe);

  /// Resets the tool; the next step starts at the device.
  void reset() noexcept;

  /// Moves the tool with the object that the hand holds, as far as the other objects of the step permit.
  void carry(const ProbeStep& step, const haptics::ToolPose& held) noexcept;
  /// Moves the tool towards the device and computes the force. Friction is that of each object's material.
  const haptics::ForceResult& render(const ProbeStep& step) noexcept;

  /// The pose of the tool.
  [[nodiscard]] const Vec3d& place() const noexcept { return tool_.last().pose.position; }
  [[nodiscard]] const haptics::ToolResult& last() const noexcept { return tool_.last(); }
  /// The tool's surface at its pose, enlarged by the collision margin.
  using Spheres = std::array<TouchSphere, spm::ProbeShape::kMaxSpheres>;
  [[nodiscard]] std::span<const TouchSphere> spheres(Spheres& out) const noexcept;
  [[nodiscard]] haptics::Tool& tool() noexcept { return tool_; }

  /// As Cycle's, with haptics::Tool's.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    tool_.for_each_carried(visit);
    visit.any("objects near a tool", objects_before_);
    visit.number("velocity of a tool", linear_), visit.number("angular velocity of a tool", angular_velocity_);
  }

 private:
  [[nodiscard]] haptics::Feel feel_of(const ProbeStep& step) const noexcept;

  haptics::Tool tool_;
  spm::ProbeShape shape_;
  std::array<haptics::ToolObject, kMaxObjects> objects_;
  std::uint64_t objects_before_ = 0;                                 // of the last step, by index bit
  Vec3d linear_ = Vec3d::Zero(), angular_velocity_ = Vec3d::Zero();  // of the tool, smoothed
};

}  // namespace tactus::hrtc_service
