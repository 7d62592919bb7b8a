#include "hrtc_service/servo/sphere_touch.hpp"

namespace tactus::hrtc_service {

SphereTouch::SphereTouch(double radius) noexcept : radius_{radius} {
  haptics::ProxySettings settings;
  settings.radius = radius;
  proxy_ = haptics::Proxy{settings};
}

/// Sets the friction of the touched object for the next step, and returns its impedance.
haptics::ContactImpedance SphereTouch::apply_material(const ProbeStep& step) noexcept {
  const session::Material* const material = step.material(proxy_.last().object);
  if (material == nullptr) return {};
  proxy_.set_grip({material->static_friction, material->dynamic_friction});
  return step.stable(*material);
}

void SphereTouch::move_to(const ProbeStep& step, const haptics::ToolPose&) noexcept {
  (void)apply_material(step);
  (void)proxy_.step(step.input.device.position, step.period, step.surface, step.mesh_changed_here);
}

const haptics::ForceResult& SphereTouch::render(const ProbeStep& step) noexcept {
  const haptics::DeviceState& device = step.input.device;
  const haptics::ContactImpedance impedance = apply_material(step);
  const haptics::Proxy before = proxy_;
  (void)proxy_.step(device.position, step.period, step.surface, step.mesh_changed_here);
  const haptics::ProxyResult& result = proxy_.last();
  // The proxy on the previous version of the mesh shows how much refinement has changed the force.
  haptics::ProxyResult unchanged;
  const bool may_be_felt = step.mesh_changed_here || !before.started() || step.surface.reached_change();
  if (may_be_felt) {
    ObjectsSurface previous_surface = step.surface.on_meshes_before();
    unchanged = before.unchanged(device.position, step.period, previous_surface);
  }
  const haptics::ForceResult& force =
      step.renderer.step(result, device, impedance, step.age(), step.period, may_be_felt ? &unchanged : nullptr);

  ProbeOutput& output = step.output;
  output.proxy = plain(result.proxy);
  output.force = plain(force.force);
  output.torque = plain(force.torque);  // fades after the held object was withdrawn
  output.object = result.in_contact ? result.object : spm::kNone;
  if (result.surface_moved) output.status |= session::kSurfaceMoved;
  if (!result.in_contact) return force;
  output.status |= session::kInContact;
  output.normal = plain(result.normal);
  output.stiffness = static_cast<float>(step.renderer.stiffness(impedance, step.period, device.round_trip));
  // The force is exact only if the mesh at the proxy is the finest, too.
  const TouchSphere proxy_sphere{result.proxy, Vec3d::Zero(), radius_};
  if ((output.status & session::kExact) != 0) step.mark_coarse({&proxy_sphere, 1});
  return force;
}

}  // namespace tactus::hrtc_service
