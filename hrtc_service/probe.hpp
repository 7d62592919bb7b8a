/// The common part of all kinds of probe: the input, the output and one step of a probe in a cycle.
///
///   SphereTouch   a sphere about the device's tip      sphere_touch.hpp
///   ToolTouch     a rigid mesh                         tool_touch.hpp
///   HeldObject    an object that a hand holds          held_object.hpp
///
/// World frame, SI. The haptic thread's. Realtime.
#pragma once

#include <cstdint>
#include <span>

#include "haptics/force.hpp"
#include "hrtc_service/touch_object.hpp"
#include "spm/target_selection.hpp"

namespace tactus::hrtc_service {

struct ProbeInput {
  bool active = false;
  haptics::DeviceState device;  ///< tip, world
  double pose_age = 0;          ///< s
  NearObjects near;             ///< from the broad phase
  bool failed = false;          ///< of the device; latches a fault
};

struct ProbeOutput {
  bool active = false;
  Plain3 device{};  ///< tip, world
  Plain3 velocity{};
  Plain3 proxy{};                     ///< or the tool's origin
  Plain4 orientation{0, 0, 0, 1};     ///< of the tool, x, y, z, w
  Plain3 force{};                     ///< on the hand, world
  Plain3 torque{};                    ///< the same, about the tip, N m
  Plain3 normal{};                    ///< of the contact, world; zero without one
  std::uint32_t object = spm::kNone;  ///< index of the one touched
  std::uint32_t status = 0;           ///< session::StatusBit
  std::uint32_t contacts = 0;
  float stiffness = 0;              ///< N/m, of the force; 0 without contact
  float error_bound = 0;            ///< m; the largest float while an object near it has no mesh yet
  float pose_age = 0;               ///< s
  std::uint32_t pose_sequence = 0;  ///< haptics::DeviceState::sequence
};

/// One of the spheres that cover a probe for refinement and queries.
struct TouchSphere {
  Vec3d centre = Vec3d::Zero(), velocity = Vec3d::Zero();
  double radius = 0;
};

/// The sphere in the object's model frame after `wait` seconds, and its displacement in the `look_ahead` seconds after.
[[nodiscard]] inline spm::PlacedSphere placed(const TouchSphere& sphere, const Placement& placement, double wait = 0,
                                              double look_ahead = 0) noexcept {
  const double scale = placement.scale();
  return {placement.to_model(sphere.centre + sphere.velocity * wait), sphere.radius / scale,
          placement.direction_to_model(sphere.velocity) * (look_ahead / scale)};
}

/// The surroundings of a probe in one cycle.
struct ProbeStep {
  const ProbeInput& input;
  ObjectsSurface& surface;
  bool mesh_changed;       ///< in the last cycle, that of an object near the probe
  bool mesh_changed_here;  ///< so near that it may move the proxy
  double period;           ///< s
  haptics::ForceRenderer& renderer;
  ProbeOutput& output;

  /// s; for the renderer.
  [[nodiscard]] double age() const noexcept { return input.pose_age - input.device.transit; }
  /// The feel of an object, or of any object near the probe when that one is not near. Null: no object is near.
  [[nodiscard]] const session::Material* material(std::uint32_t object) const noexcept;
  /// Takes session::kExact from the output where some object is not the finest mesh in these spheres.
  void mark_coarse(std::span<const TouchSphere> spheres) const noexcept;
};

}  // namespace tactus::hrtc_service
