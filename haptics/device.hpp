/// Interface of a haptic device in its own frame, and the frame that maps the device into the world.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <stdexcept>
#include <string>

#include "spm/model.hpp"

namespace tactus::haptics {

using spm::Vec3d;

/// Limits of a device in its own frame.
struct DeviceSpec {
  double max_force = 10;                ///< N
  double max_stiffness = 5000;          ///< N/m, the vendor's limit
  double damping = 3;                   ///< N s/m, min physical damping of the device; limits the stable stiffness
  double workspace_radius = 0.2;        ///< m
  double max_torque = 0;                ///< N m; 0: forces only
  double max_rotational_stiffness = 1;  ///< N m/rad, the vendor's limit
};

/// Bits of DeviceState::buttons.
enum Button : std::uint32_t {
  kClutchButton = 1u << 0,  ///< while it is pressed the device moves and the tip does not
  kGrabButton = 1u << 1,    ///< while it is pressed the hand holds a movable object that it touches
  kStopButton = 1u << 2     ///< pressing it is an emergency stop; while it is pressed, no reset ends the stop
};

struct DeviceState {
  Vec3d position = Vec3d::Zero();  ///< of the tip, m
  Vec3d velocity = Vec3d::Zero();  ///< m/s
  Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity();
  std::uint32_t buttons = 0;  ///< Button
  std::int64_t time_ns = 0;   ///< time of the measurement, on the clock given to `read`

  // Only of a device in another process or on another machine:
  std::uint32_t sequence = 0;  ///< the sender's sequence number of the pose
  double transit = 0;          ///< s, transit of the pose; part of pose_age, but not of the age that makes a pose stale
  double round_trip = 0;       ///< s, bound of the round trip from HRTC to device and back (stable_stiffness)
};

/// Error of a device that cannot be opened. The message names the device, or file and line, the value found and the
/// value expected.
class DeviceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Checks the limits of a device whose driver is `library`. Throws DeviceError if one is impossible.
void check(const DeviceSpec& spec, const std::string& library);

enum class DeviceHealth : std::uint8_t {
  kReady,
  kEnded,  ///< a replay has played its last pose
  kFailed
};

/// The constructor opens the device, or throws DeviceError. The destructor commands zero force and closes the device.
/// `read` and `write` run in one thread. The calls of a driver run in the main thread of tactus-device, those of other
/// devices in the haptic thread, where they are realtime.
class Device {
 public:
  virtual ~Device() = default;
  [[nodiscard]] virtual const DeviceSpec& spec() const noexcept = 0;
  /// Returns the newest state. `now_ns` never decreases.
  [[nodiscard]] virtual DeviceState read(std::int64_t now_ns) noexcept = 0;
  /// Sets the force on the user's hand until the next write, N in the device's frame.
  virtual void write(const Vec3d& force) noexcept = 0;
  /// Sets force and torque about the tip, N m. A cycle calls it instead of `write`; devices without torque ignore the
  /// torque.
  virtual void write_wrench(const Vec3d& force, const Vec3d& /*torque*/) noexcept { write(force); }
  [[nodiscard]] virtual DeviceHealth health() const noexcept = 0;
};

/// The pose of a device in the world: tip = rotation * (scale * position) + translation.
///
/// A force does the same work in both frames. So a force f in the world is scale * rotation^-1 * f in the device's
/// frame, and a stiffness is scale^2 times as large in the device's frame as in the world. Therefore a scale above 1
/// lowers the device's force, stiffness and damping in the world, and enlarges its workspace. While the clutch is down,
/// the tip does not move, but its orientation still follows the device. One thread at a time. Realtime.
class DeviceFrame {
 public:
  explicit DeviceFrame(const Eigen::Quaterniond& rotation = Eigen::Quaterniond::Identity(),
                       const Vec3d& translation = Vec3d::Zero(), double scale = 1) noexcept
      : rotation_{rotation.normalized()}, translation_{translation}, scale_{scale} {}

  /// Returns the device's state in the world; call it once per cycle. After the clutch is released, the tip continues
  /// from its last finite position.
  [[nodiscard]] DeviceState to_world(const DeviceState& device, bool clutched) noexcept {
    DeviceState world = device;
    const Vec3d moved = rotation_ * (scale_ * device.position);
    clutched_ = clutched;
    if (moved.allFinite()) {
      if (clutched && started_) translation_ = tip_ - moved;
      started_ = true;
      tip_ = moved + translation_;
    }
    world.position = moved + translation_;
    world.velocity = clutched ? Vec3d::Zero() : Vec3d(rotation_ * (scale_ * device.velocity));
    world.orientation = rotation_ * device.orientation;
    return world;
  }

  [[nodiscard]] double scale() const noexcept { return scale_; }
  /// Converts a world force to the device's frame. Zero while the clutch is down, because the hand is not at the tip.
  [[nodiscard]] Vec3d force_to_device(const Vec3d& force_world) const noexcept {
    if (clutched_) return Vec3d::Zero();
    return scale_ * (rotation_.conjugate() * force_world);
  }
  /// Converts a world torque to the device's frame; torques are not scaled.
  [[nodiscard]] Vec3d torque_to_device(const Vec3d& torque_world) const noexcept {
    if (clutched_) return Vec3d::Zero();
    return rotation_.conjugate() * torque_world;
  }

  /// Converts the device's limits to world units.
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
