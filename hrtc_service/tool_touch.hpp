/// A probe that holds a tool, as the cycle sees it: the tool itself, and the balls that stand for it where the mesh is
/// refined and asked about.
///
/// The mesh has to be the finest one along the tool, wherever it is near a surface; balls in a row ask for that and
/// for little else. Where they go is told from how the tool has moved of late. World frame, SI. The haptic thread's.
/// Realtime after construction.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "haptics/tool.hpp"
#include "hrtc_service/touch_object.hpp"
#include "spm/probe_spheres.hpp"

namespace tactus::hrtc_service {

inline constexpr std::uint32_t kMaxSpheres = 8;  ///< of a probe; more would ask for less, and take longer to do so

/// What stands for a tool, its rounding within; m, in its frame; none for null. Loader and cycle ask by the same.
[[nodiscard]] std::vector<spm::ProbeSphere> spheres_of_tool(const spm::MeshProbe* tool);

class ToolTouch {
 public:
  struct Sphere {
    Vec3d centre, velocity;
    double radius;
  };

  /// `probe` in metres; must outlive it. Allocates.
  explicit ToolTouch(const spm::MeshProbe& probe);

  /// Forgets everything; the next step starts at the device.
  void reset() noexcept;

  /// One cycle of `dt` seconds among the objects of `surface`. `changed`: some of their meshes, near it. Friction is
  /// that of each one's material.
  const haptics::ToolResult& step(const haptics::ToolPose& device, double dt, const haptics::ToolGrip& grip,
                                  const ObjectsSurface& surface, bool changed) noexcept;

  [[nodiscard]] const haptics::ToolResult& last() const noexcept { return tool_.last(); }
  [[nodiscard]] std::uint32_t spheres() const noexcept { return static_cast<std::uint32_t>(spheres_.size()); }
  /// Where the tool now is; its radius holds the tool's rounding.
  [[nodiscard]] Sphere sphere(std::uint32_t number) const noexcept;
  [[nodiscard]] haptics::Tool& tool() noexcept { return tool_; }

  /// As Cycle's, with haptics::Tool's.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    tool_.for_each_carried(visit);
    visit.any("objects near a tool", objects_before_);
    visit.number("velocity of a tool", linear_), visit.number("angular velocity of a tool", angular_velocity_);
  }

 private:
  haptics::Tool tool_;
  std::vector<spm::ProbeSphere> spheres_;  // tool's frame
  std::array<haptics::ToolObject, kMaxObjects> objects_;
  std::uint64_t objects_before_ = 0;                                 // of the last step, by index bit
  Vec3d linear_ = Vec3d::Zero(), angular_velocity_ = Vec3d::Zero();  // of the tool, smoothed
};

}  // namespace tactus::hrtc_service
