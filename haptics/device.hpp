/// A haptic device as the cycle sees it, and the frame that puts it into the world.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <stdexcept>

#include "spm/model.hpp"

namespace tactus::haptics {

using spm::Vec3d;

/// What a device can do, in its own frame.
struct DeviceSpec {
  double max_force = 10;                ///< N
  double max_stiffness = 5000;          ///< N/m that the maker vouches for
  double damping = 3;                   ///< N s/m, physical, at the least; sets the stiffness that stays stable
  double workspace_radius = 0.2;        ///< m
  double max_torque = 0;                ///< N m; 0: it bears forces only
  double max_rotational_stiffness = 1;  ///< N m/rad that the maker vouches for
};

/// Bits of DeviceState::buttons.
enum Button : std::uint32_t {
  kClutchButton = 1u << 0,  ///< while it is down the device moves and the tip does not
  kGrabButton = 1u << 1     ///< while it is down the hand holds on to what it touches, if that can move
};

struct DeviceState {
  Vec3d position = Vec3d::Zero();  ///< of the tip, m
  Vec3d velocity = Vec3d::Zero();  ///< m/s
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
  std::uint32_t buttons = 0;  ///< Button
  std::int64_t time_ns = 0;   ///< when it was so, on the clock given to `read`

  // Of a device that is not on this machine.
  std::uint32_t sequence = 0;  ///< that its maker gave the pose
  double transit = 0;          ///< s that it took to come here: so much of its age is no silence
  double loop_delay = 0;       ///< s from the pose to its force in the hand, beyond half a cycle
};

/// A device that cannot be opened; the message names device or file, line, what was found and what was expected.
class DeviceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class DeviceHealth : std::uint8_t {
  kReady,
  kEnded,  ///< a replay past its last pose
  kFailed
};

/// Opened by its constructor, which throws DeviceError; closed, with zero force, by its destructor. The rest is called
/// in the haptic thread and is realtime, but for what the system calls of a real device cost.
class Device {
 public:
  virtual ~Device() = default;
  [[nodiscard]] virtual const DeviceSpec& spec() const noexcept = 0;
  /// The newest state. `now_ns` never goes back.
  [[nodiscard]] virtual DeviceState read(std::int64_t now_ns) noexcept = 0;
  /// The force on the user's hand, N in the device's frame, held until the next write.
  virtual void write(const Vec3d& force) noexcept = 0;
  /// The same with a torque about the tip, N m, for devices that bear one; called in its place.
  virtual void write_wrench(const Vec3d& force, const Vec3d& /*torque*/) noexcept { write(force); }
  [[nodiscard]] virtual DeviceHealth health() const noexcept = 0;
};

/// Where a device stands in the world: tip = rotation * (scale * position) + translation.
///
/// Work is the same on both sides, so a force comes back as scale * rotation^-1 * force, and a world stiffness is felt
/// scale^2 times as stiff: enlarged motions meet softer limits. While clutched the device moves and the tip does not.
/// One thread at a time. Realtime.
class DeviceFrame {
 public:
  explicit DeviceFrame(const Eigen::Quaterniond& rotation = Eigen::Quaterniond::Identity(),
                       const Vec3d& translation = Vec3d::Zero(), double scale = 1) noexcept
      : rotation_{rotation.normalized()}, translation_{translation}, scale_{scale} {}

  /// The device's state in the world, once each cycle. At the cycle in which the clutch is let go the tip goes on from
  /// where it stood.
  [[nodiscard]] DeviceState to_world(const DeviceState& device, bool clutched) noexcept {
    DeviceState world = device;
    const Vec3d moved = rotation_ * (scale_ * device.position);
    if (clutched && started_) translation_ = tip_ - moved;
    started_ = true;
    clutched_ = clutched;
    world.position = tip_ = moved + translation_;
    world.velocity = clutched ? Vec3d::Zero() : Vec3d(rotation_ * (scale_ * device.velocity));
    world.orientation = rotation_ * device.orientation;
    return world;
  }

  /// A world force for the device; none while clutched, when the hand is elsewhere than the tip.
  [[nodiscard]] Vec3d force_to_device(const Vec3d& force_world) const noexcept {
    if (clutched_) return Vec3d::Zero();
    return scale_ * (rotation_.conjugate() * force_world);
  }
  /// The same of a torque: turns are not scaled.
  [[nodiscard]] Vec3d torque_to_device(const Vec3d& torque_world) const noexcept {
    if (clutched_) return Vec3d::Zero();
    return rotation_.conjugate() * torque_world;
  }

  /// The device's limits as the world meets them.
  [[nodiscard]] DeviceSpec to_world(const DeviceSpec& spec) const noexcept {
    return {spec.max_force / scale_,
            spec.max_stiffness / (scale_ * scale_),
            spec.damping / (scale_ * scale_),
            spec.workspace_radius * scale_,
            spec.max_torque,
            spec.max_rotational_stiffness};
  }

 private:
  Eigen::Quaterniond rotation_;
  Vec3d translation_;
  double scale_;
  Vec3d tip_ = Vec3d::Zero();
  bool started_ = false;
  bool clutched_ = false;
};

}  // namespace tactus::haptics
