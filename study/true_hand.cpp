#include "study/true_hand.hpp"

#include "study/constants.hpp"

namespace tactus::study {
namespace {

haptics::ProxySettings proxy_settings(double radius) {
  haptics::ProxySettings settings;
  settings.radius = radius;
  return settings;
}

}  // namespace

TrueSphere::TrueSphere(haptics::Surface& surface, double radius, const session::Material& material,
                       const haptics::ForceSettings& settings)
    : surface_{surface},
      impedance_{material.stiffness, material.damping},
      proxy_{proxy_settings(radius)},
      renderer_{settings, haptics::DeviceSpec{}} {
  proxy_.set_grip({material.static_friction, material.dynamic_friction});
}

haptics::Wrench TrueSphere::at(const haptics::DeviceState& device, bool) {
  const haptics::ProxyResult& proxy = proxy_.step(device.position, kCycle, surface_, false);
  return {renderer_.step(proxy, device, impedance_, 0, kCycle).force, spm::Vec3d::Zero()};
}

TrueTool::TrueTool(const spm::FinestTree& mesh, double scale, const spm::MeshProbe& probe,
                   const session::Material& material, const haptics::ForceSettings& settings,
                   const haptics::DeviceSpec& spec)
    : impedance_{material.stiffness, material.damping}, tool_{probe}, renderer_{settings, spec} {
  object_.tree = &mesh.tree();
  object_.scale = scale;
  object_.friction = material.dynamic_friction;
}

haptics::Wrench TrueTool::at(const haptics::DeviceState& device, bool mesh_changed) {
  const haptics::ToolGrip grip = renderer_.tool_grip(impedance_, kCycle, device.round_trip);
  tool_.set_grip(grip);
  const haptics::ToolResult& tool =
      tool_.step({device.position, device.orientation}, kCycle, {&object_, 1}, mesh_changed);
  const haptics::ForceResult& result = renderer_.step(tool, grip, device, impedance_, 0, kCycle);
  return {result.force, result.torque};
}

}  // namespace tactus::study
