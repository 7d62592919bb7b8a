#include "hrtc_service/servo/tool_touch.hpp"

#include <algorithm>

#include "haptics/rigid_body.hpp"

namespace tactus::hrtc_service {

spm::ProbeShape shape_of_probe(const spm::MeshProbe* tool, double radius) {
  if (tool == nullptr) return spm::ProbeShape{radius};
  return spm::ProbeShape{*tool, haptics::ToolSettings{}.collision_margin};
}

ToolTouch::ToolTouch(const spm::MeshProbe& probe) : tool_{probe}, shape_{shape_of_probe(&probe, 0)} {}

void ToolTouch::reset() noexcept {
  tool_.reset();
  objects_before_ = 0;
  velocity_.setZero();
  angular_velocity_.setZero();
}

void ToolTouch::move_to(const ProbeStep& step, const haptics::ToolPose& goal) noexcept {
  const ObjectsSurface& surface = step.surface;
  std::uint64_t near = 0;
  for (std::uint32_t i = 0; i < surface.count(); ++i) {
    const TouchObject& object = surface[i];
    const Placement& placement = surface.placement(i);
    // A tool that sticks to a moving object does not follow it. So the tool slides on movable objects.
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
  tool_.set_grip(step.renderer.tool_grip(impedance_of(step), step.period, step.input.device.round_trip));
  const bool changed = step.mesh_changed || step.mesh_changed_here || surface.moving() || near != objects_before_;
  const haptics::ToolPose& now = tool_.step(goal, step.period, {objects_.data(), surface.count()}, changed).pose;
  objects_before_ = near;
  constexpr double kSmoothing = 0.008;  // s
  const double share = std::min(1.0, step.period / kSmoothing);
  const Vec3d turned = haptics::log_map(now.orientation * before.orientation.conjugate());
  velocity_ += share * ((now.position - before.position) / step.period - velocity_);
  angular_velocity_ += share * (turned / step.period - angular_velocity_);
  step.output.orientation = plain(now.orientation);
}

/// Returns the impedance of the touched object.
haptics::ContactImpedance ToolTouch::impedance_of(const ProbeStep& step) const noexcept {
  const session::Material* const material = step.material(tool_.last().object);
  return material != nullptr ? step.stable(*material) : haptics::ContactImpedance{};
}

const haptics::ForceResult& ToolTouch::render(const ProbeStep& step) noexcept {
  haptics::DeviceState device = step.input.device;
  const haptics::ContactImpedance impedance = impedance_of(step);
  const haptics::ToolGrip grip = step.renderer.tool_grip(impedance, step.period, device.round_trip);
  move_to(step, {device.position, device.orientation});
  const haptics::ToolResult& result = tool_.last();
  // The damper acts on the velocity relative to the touched object.
  if (result.in_contact)
    device.velocity -= (result.point - step.surface.previous_point(result.object, result.point)) / step.period;
  const haptics::ForceResult& force = step.renderer.step(result, grip, device, impedance, step.age(), step.period);

  ProbeOutput& output = step.output;
  output.status |= session::kExact;
  output.error_bound = 0;
  Spheres spheres;
  step.mark_coarse(this->spheres(spheres));
  output.proxy = plain(result.pose.position);
  output.force = plain(force.force);
  output.torque = plain(force.torque);
  output.contacts = result.contacts;
  output.object = result.in_contact ? result.object : spm::kNone;
  if (result.too_near) output.status |= session::kSurfaceMoved;
  if (!result.in_contact) return force;
  output.status |= session::kInContact;
  output.normal = plain(result.normal);
  output.stiffness = static_cast<float>(grip.stiffness);
  return force;
}

std::span<const TouchSphere> ToolTouch::spheres(Spheres& out) const noexcept {
  const haptics::ToolPose& pose = tool_.last().pose;
  const std::span<const spm::ProbeSphere> spheres = shape_.spheres();
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    const Vec3d arm = pose.orientation * spheres[i].centre;
    out[i] = {pose.position + arm, velocity_ + angular_velocity_.cross(arm), spheres[i].radius};
  }
  return {out.data(), spheres.size()};
}

}  // namespace tactus::hrtc_service
