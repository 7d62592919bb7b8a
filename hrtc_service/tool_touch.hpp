/// A probe that holds a tool: the tool itself, the force with which it pulls the hand, and the spheres that stand for
/// it where the mesh is refined and asked about.
///
/// Where the spheres go is told from how the tool has moved of late. World frame, SI. The haptic thread's. Realtime
/// after construction.
#pragma once

#include <array>
#include <cstdint>

#include "haptics/tool.hpp"
#include "hrtc_service/probe.hpp"
#include "spm/probe_spheres.hpp"

namespace tactus::hrtc_service {

/// Where the mesh has to be the finest one for a probe: around a tool, within the margin at which it collides; or
/// around a tip of that radius when `tool` is null. m. Loader and cycle go by the same.
[[nodiscard]] spm::ProbeShape shape_of_probe(const spm::MeshProbe* tool, double radius);

class ToolTouch {
 public:
  /// `probe` in metres; must outlive it. Allocates.
  explicit ToolTouch(const spm::MeshProbe& probe);

  /// Forgets everything; the next step starts at the device.
  void reset() noexcept;

  /// Moves the tool while the hand holds something: along with that, as far as the objects of the step let it.
  void carry(const ProbeStep& step, const haptics::ToolPose& held) noexcept;
  /// Moves the tool towards the device, and makes the force. Friction is that of each object's material.
  const haptics::ForceResult& render(const ProbeStep& step) noexcept;

  /// Where the tool is.
  [[nodiscard]] const Vec3d& place() const noexcept { return tool_.last().pose.position; }
  [[nodiscard]] const haptics::ToolResult& last() const noexcept { return tool_.last(); }
  /// The tool's surface where it now is, within the margin at which it collides.
  using Spheres = std::array<TouchSphere, spm::ProbeShape::kMaxSpheres>;
  [[nodiscard]] spm::Span<const TouchSphere> spheres(Spheres& out) const noexcept;
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
