/// A haptic device in its own frame, and the frame that maps it into the world.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <stdexcept>

#include "spm/model.hpp"

namespace tactus::haptics {

using spm::Vec3d;

/// Limits of a device in its own frame.
struct DeviceSpec {
  double max_force = 10;                ///< N
  double max_stiffness = 5000;          ///< N/m, the vendor's limit
  double damping = 3;                   ///< N s/m, physical, minimum; sets the stiffness that stays stable
  double workspace_radius = 0.2;        ///< m
  double max_torque = 0;                ///< N m; 0: forces only
  double max_rotational_stiffness = 1;  ///< N m/rad, the vendor's limit
};

/// Bits of DeviceState::buttons.
enum Button : std::uint32_t {
  kClutchButton = 1u << 0,  ///< while it is pressed the device moves and the tip does not
  kGrabButton = 1u << 1     ///< while it is pressed the hand holds a movable object that it touches
};

struct DeviceState {
  Vec3d position = Vec3d::Zero();  ///< of the tip, m
  Vec3d velocity = Vec3d::Zero();  ///< m/s
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
  std::uint32_t buttons = 0;  ///< Button
  std::int64_t time_ns = 0;   ///< time of the measurement, on the clock given to `read`

  // Of a device on another machine.
  std::uint32_t sequence = 0;  ///< the sequence number that the sender gave the pose
  double transit = 0;          ///< s, time the pose took to arrive; not counted as silence
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

/// The constructor opens the device and throws DeviceError. The destructor commands zero force and closes it.
/// Everything else runs in the haptic thread and is realtime, except for the system calls of a real device.
class Device {
 public:
  virtual ~Device() = default;
  [[nodiscard]] virtual const DeviceSpec& spec() const noexcept = 0;
  /// The newest state. `now_ns` never goes back.
  [[nodiscard]] virtual DeviceState read(std::int64_t now_ns) noexcept = 0;
  /// The force on the user's hand, N in the device's frame, held until the next write.
  virtual void write(const Vec3d& force) noexcept = 0;
  /// Force and a torque about the tip, N m, for devices that can exert one; called instead of `write`.
  virtual void write_wrench(const Vec3d& force, const Vec3d& /*torque*/) noexcept { write(force); }
  [[nodiscard]] virtual DeviceHealth health() const noexcept = 0;
};

/// The pose of a device in the world: tip = rotation * (scale * position) + translation.
///
/// Work is equal on both sides, so a force comes back as scale * rotation^-1 * force, and a world stiffness feels
/// scale^2 times as stiff: enlarged motions have lower limits. While clutched the device moves and the tip does not.
/// One thread at a time. Realtime.
class DeviceFrame {
 public:
  explicit DeviceFrame(const Eigen::Quaterniond& rotation = Eigen::Quaterniond::Identity(),
                       const Vec3d& translation = Vec3d::Zero(), double scale = 1) noexcept
      : rotation_{rotation.normalized()}, translation_{translation}, scale_{scale} {}

  /// The device's state in the world, once per cycle. After the clutch is released the tip continues from where it was.
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

  /// A world force in the device's frame; zero while clutched, because the hand is not at the tip.
  [[nodiscard]] Vec3d force_to_device(const Vec3d& force_world) const noexcept {
    if (clutched_) return Vec3d::Zero();
    return scale_ * (rotation_.conjugate() * force_world);
  }
  /// A torque in the device's frame; torques are not scaled.
  [[nodiscard]] Vec3d torque_to_device(const Vec3d& torque_world) const noexcept {
    if (clutched_) return Vec3d::Zero();
    return rotation_.conjugate() * torque_world;
  }

  /// The device's limits in world units.
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
