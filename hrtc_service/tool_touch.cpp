#include "hrtc_service/tool_touch.hpp"

#include <algorithm>

#include "haptics/rigid_body.hpp"

namespace tactus::hrtc_service {

std::vector<spm::ProbeSphere> spheres_of_tool(const spm::MeshProbe* tool) {
  std::vector<spm::ProbeSphere> spheres;
  if (tool != nullptr) spheres = spm::spheres_of(*tool, kMaxSpheres);
  for (spm::ProbeSphere& sphere : spheres) sphere.radius += haptics::ToolSettings{}.collision_margin;
  return spheres;
}

ToolTouch::ToolTouch(const spm::MeshProbe& probe) : tool_{probe}, spheres_{spheres_of_tool(&probe)} {}

void ToolTouch::reset() noexcept {
  tool_.reset();
  objects_before_ = 0;
  linear_.setZero();
  angular_velocity_.setZero();
}

const haptics::ToolResult& ToolTouch::step(const haptics::ToolPose& device, double dt, const haptics::ToolGrip& grip,
                                           const ObjectsSurface& surface, bool changed) noexcept {
  std::uint64_t near = 0;
  for (std::uint32_t i = 0; i < surface.count(); ++i) {
    const TouchObject& object = surface[i];
    const Placement& placement = surface.placement(i);
    // What moves would carry a tool that sticks to it; a tool does not go along, so it slides.
    const double friction = object.body ? 0 : object.material.dynamic_friction;
    objects_[i] = {&object.forest->tree(),
                   placement.rotation(),
                   placement.translation(),
                   placement.scale(),
                   friction,
                   object.index};
    near |= std::uint64_t{1} << object.index;
  }
  const haptics::ToolPose before = tool_.last().pose;
  tool_.set_grip(grip);
  const haptics::ToolResult& result = tool_.step(device, dt, {objects_.data(), surface.count()},
                                                 changed || surface.moving() || near != objects_before_);
  objects_before_ = near;
  constexpr double kSmoothing = 0.008;  // s
  const double share = std::min(1.0, dt / kSmoothing);
  linear_ += share * ((result.pose.position - before.position) / dt - linear_);
  angular_velocity_ +=
      share * (haptics::log_map(result.pose.orientation * before.orientation.conjugate()) / dt - angular_velocity_);
  return result;
}

ToolTouch::Sphere ToolTouch::sphere(std::uint32_t number) const noexcept {
  const haptics::ToolPose& pose = tool_.last().pose;
  const Vec3d arm = pose.orientation * spheres_[number].centre;
  return {pose.position + arm, linear_ + angular_velocity_.cross(arm), spheres_[number].radius};
}

}  // namespace tactus::hrtc_service
