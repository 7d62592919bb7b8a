/// Types common to all kinds of probe: input, output and one step of a probe in a cycle.
///
///   SphereTouch   a sphere about the device's tip      sphere_touch.hpp
///   ToolTouch     a rigid mesh                         tool_touch.hpp
///   HeldObject    an object that a hand holds          held_object.hpp
///
/// World frame, SI. Haptic thread. Realtime.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "haptics/force.hpp"
#include "hrtc_service/servo/touch_object.hpp"
#include "spm/target_selection.hpp"

namespace tactus::hrtc_service {

struct ProbeInput {
  bool active = false;
  haptics::DeviceState device;  ///< state of the tip, world
  double pose_age = 0;          ///< age of the pose with its transit, s
  NearObjects near;             ///< from the broad phase
  bool failed = false;          ///< the device has failed, which latches a fault
};

struct ProbeOutput {
  bool active = false;
  Plain3 device{};                    ///< position of the tip, world
  Plain3 velocity{};                  ///< of the tip, world
  Plain3 proxy{};                     ///< position of the proxy, or of the tool's origin, world
  Plain4 orientation{0, 0, 0, 1};     ///< of the tool, x, y, z, w
  Plain3 force{};                     ///< force on the hand, world, N
  Plain3 torque{};                    ///< torque on the hand about the tip, world, N m
  Plain3 normal{};                    ///< contact normal, world; zero without contact
  std::uint32_t object = spm::kNone;  ///< index of the touched object
  std::uint32_t status = 0;           ///< session::StatusBit
  std::uint32_t contacts = 0;
  float stiffness = 0;              ///< stiffness with which the force was computed, N/m; 0 without contact
  float error_bound = 0;            ///< m; the largest float if an object near the probe has no mesh yet
  float pose_age = 0;               ///< s
  std::uint32_t pose_sequence = 0;  ///< haptics::DeviceState::sequence
};

/// Returns the age of the probe's pose, us.
[[nodiscard]] inline std::uint32_t age_us(const ProbeOutput& probe) noexcept {
  return static_cast<std::uint32_t>(std::clamp(probe.pose_age * 1e6f, 0.0f, 4e9f));
}

/// One of the spheres that cover a probe for refinement and queries. World frame.
struct TouchSphere {
  Vec3d centre = Vec3d::Zero(), velocity = Vec3d::Zero();
  double radius = 0;
};

/// Returns the sphere in an object's model frame: its predicted position after `wait` seconds, and its displacement in
/// the next `look_ahead` seconds.
[[nodiscard]] inline spm::PlacedSphere placed(const TouchSphere& sphere, const Placement& placement, double wait = 0,
                                              double look_ahead = 0) noexcept {
  const double scale = placement.scale();
  return {placement.to_model(sphere.centre + sphere.velocity * wait), sphere.radius / scale,
          placement.direction_to_model(sphere.velocity) * (look_ahead / scale)};
}

/// The arguments of one step of a probe.
struct ProbeStep {
  const ProbeInput& input;
  ObjectsSurface& surface;
  bool mesh_changed;       ///< the mesh of an object near the probe changed in the last cycle
  bool mesh_changed_here;  ///< a mesh changed so near the proxy that the proxy may move
  double period;           ///< s
  haptics::ForceRenderer& renderer;
  ProbeOutput& output;

  /// Returns the age of the pose without its transit, s.
  [[nodiscard]] double age() const noexcept { return input.pose_age - input.device.transit; }
  /// Returns the material of the object, or of any object near the probe if that object is not near. Returns null if no
  /// object is near.
  [[nodiscard]] const session::Material* material(std::uint32_t object) const noexcept;
  /// Returns the impedance of a material, with a damping that is stable on the device of the probe.
  [[nodiscard]] haptics::ContactImpedance stable(const session::Material& material) const noexcept {
    return haptics::ForceRenderer::with_stable_damping({material.stiffness, material.damping}, period,
                                                       input.device.round_trip);
  }
  /// If a mesh within these spheres is not the finest, clears session::kExact of the output and raises its error bound.
  void mark_coarse(std::span<const TouchSphere> spheres) const noexcept;
};

}  // namespace tactus::hrtc_service
