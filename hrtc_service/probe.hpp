/// What every kind of probe has in common: what a cycle gets and gives for it, and one step of it.
///
///   SphereTouch   a sphere about the device's tip      sphere_touch.hpp
///   ToolTouch     a rigid mesh                         tool_touch.hpp
///   HeldObject    what a hand has closed on            held_object.hpp
///
/// World frame, SI. The haptic thread's. Realtime.
#pragma once

#include <cstdint>

#include "haptics/force.hpp"
#include "hrtc_service/touch_object.hpp"
#include "spm/target_selection.hpp"

namespace tactus::hrtc_service {

struct ProbeInput {
  bool active = false;
  haptics::DeviceState device;  ///< tip, world
  double pose_age = 0;          ///< s
  NearObjects near;             ///< from the broad phase
  bool failed = false;          ///< the device did; latches a fault
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
  float stiffness = 0;              ///< N/m, with which the force was made; 0 without contact
  float error_bound = 0;            ///< m; the greatest of all numbers while an object near it is not shown yet
  float pose_age = 0;               ///< s
  std::uint32_t pose_sequence = 0;  ///< haptics::DeviceState::sequence
};

/// One of the spheres that stand for a probe where the mesh is refined and asked about.
struct TouchSphere {
  Vec3d centre = Vec3d::Zero(), velocity = Vec3d::Zero();
  double radius = 0;
};

/// The sphere in the object's model frame after `wait` seconds, and where it goes in the `look_ahead` seconds after.
[[nodiscard]] inline spm::PlacedSphere placed(const TouchSphere& sphere, const Placement& placement, double wait = 0,
                                              double look_ahead = 0) noexcept {
  const double scale = placement.scale();
  return {placement.to_model(sphere.centre + sphere.velocity * wait), sphere.radius / scale,
          placement.direction_to_model(sphere.velocity) * (look_ahead / scale)};
}

/// What a probe has to work with in one cycle.
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
  /// What an object feels like; or any near the probe, when that one is not. Null without any.
  [[nodiscard]] const session::Material* material(std::uint32_t object) const noexcept;
  /// Takes session::kExact from the output where some object is not the finest mesh in these spheres.
  void mark_coarse(spm::Span<const TouchSphere> spheres) const noexcept;
};

}  // namespace tactus::hrtc_service
