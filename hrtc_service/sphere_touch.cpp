#include "hrtc_service/sphere_touch.hpp"

namespace tactus::hrtc_service {

SphereTouch::SphereTouch(double radius) noexcept : radius_{radius} {
  haptics::ProxySettings settings;
  settings.radius = radius;
  proxy_ = haptics::Proxy{settings};
}

/// Sets the friction of the touched object for the next step, and returns its feel.
haptics::Feel SphereTouch::take_material(const ProbeStep& step) noexcept {
  const session::Material* const material = step.material(proxy_.last().object);
  if (material == nullptr) return {};
  proxy_.set_grip({material->static_friction, material->dynamic_friction});
  return {material->stiffness, material->damping};
}

void SphereTouch::carry(const ProbeStep& step, const haptics::ToolPose&) noexcept {
  (void)take_material(step);
  (void)proxy_.step(step.input.device.position, step.period, step.surface, step.mesh_changed_here);
}

const haptics::ForceResult& SphereTouch::render(const ProbeStep& step) noexcept {
  const haptics::DeviceState& device = step.input.device;
  const haptics::Feel feel = take_material(step);
  const haptics::Proxy before = proxy_;
  (void)proxy_.step(device.position, step.period, step.surface, step.mesh_changed_here);
  const haptics::ProxyResult& result = proxy_.last();
  // The effect of refinement under the tip is the difference to the proxy on the previous version of the mesh.
  haptics::ProxyResult unchanged;
  const bool felt = step.mesh_changed_here || !before.started() || step.surface.met_change();
  if (felt) {
    ObjectsSurface as_before = step.surface.on_meshes_before();
    unchanged = before.unchanged(device.position, step.period, as_before);
  }
  const haptics::ForceResult& force =
      step.renderer.step(result, device, feel, step.age(), step.period, felt ? &unchanged : nullptr);

  ProbeOutput& output = step.output;
  output.proxy = plain(result.proxy);
  output.force = plain(force.force);
  output.torque = plain(force.torque);  // fades after a hold of a withdrawn object
  output.object = result.in_contact ? result.object : spm::kNone;
  if (result.surface_moved) output.status |= session::kSurfaceMoved;
  if (!result.in_contact) return force;
  output.status |= session::kInContact;
  output.normal = plain(result.normal);
  output.stiffness = static_cast<float>(step.renderer.stiffness(feel, step.period, device.loop_delay));
  // The force is exact when the surface at the proxy is, too.
  const TouchSphere around{result.proxy, Vec3d::Zero(), radius_};
  if ((output.status & session::kExact) != 0) step.mark_coarse({&around, 1});
  return force;
}

}  // namespace tactus::hrtc_service
