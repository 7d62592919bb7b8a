/// A hand that holds a device, simulated: what a scripted user's probe is inside a controller.
///
///     hand's target --[ spring, damper ]-- device's mass --[ damper ]-- ground
///                                            ^ force of the surface
///
/// It is turned in the same way: by the wrist's spring and damper, against an inertia that is the same about all axes.
/// Device frame, SI. `read` moves the simulation on to the time given, with the wrench last written held meanwhile.
#pragma once

#include <array>
#include <cstdint>
#include <random>

#include "haptics/device.hpp"
#include "haptics/mailbox.hpp"

namespace tactus::haptics {

inline constexpr std::size_t kMaxHandWaypoints = 16;

/// Where a hand wants to be: even between waypoints of ascending time; holds the first before and the last after.
struct HandPath {
  struct Waypoint {
    std::int64_t time_ns;
    std::array<double, 3> position;
    std::array<double, 4> orientation{0, 0, 0, 1};  ///< unit quaternion x, y, z, w
  };
  std::array<Waypoint, kMaxHandWaypoints> waypoints{};
  std::uint32_t count = 0;    ///< 0: no wish; the hand keeps the one it had
  std::uint32_t buttons = 0;  ///< that it holds down meanwhile, Button

  /// Position and velocity wanted at a time; `count` must not be 0. Realtime.
  void at(std::int64_t time_ns, Vec3d& position, Vec3d& velocity) const noexcept;
  /// How it is to be turned then. Realtime.
  [[nodiscard]] Eigen::Quaterniond orientation_at(std::int64_t time_ns) const noexcept;

 private:
  /// The waypoints on both sides of a time and how far it is from one to the other; the same twice beyond the ends.
  struct Place {
    const Waypoint *from, *to;
    double share, rate;  // 1/s, of the way between the two
  };
  [[nodiscard]] Place place_at(std::int64_t time_ns) const noexcept;
};

struct HandSettings {
  double mass = 0.2;            ///< kg, of the device
  double hand_stiffness = 250;  ///< N/m
  double hand_damping = 5;      ///< N s/m
  double tremor = 0;            ///< m, root mean square of the 8-12 Hz shake of the target
  double noise = 0;             ///< m, standard deviation of a position reading
  double encoder_step = 0;      ///< m; 0: continuous
  std::uint32_t seed = 1;       ///< of tremor and noise
  Vec3d start = Vec3d::Zero();  ///< where the hand rests until its first path
  Eigen::Quaterniond start_orientation = Eigen::Quaterniond::Identity();  ///< and how
  double inertia = 2e-4;                                                  ///< kg m^2, of the device about its tip
  double wrist_stiffness = 1;                                             ///< N m/rad
  double wrist_damping = 0.03;                                            ///< N m s
};

class SimulatedDevice final : public Device {
 public:
  explicit SimulatedDevice(const HandSettings& settings = {}, const DeviceSpec& spec = {});

  /// Any one other thread posts the hand's wishes here; times are of the clock given to `read`.
  [[nodiscard]] Mailbox<HandPath>& paths() noexcept { return wishes_; }

  [[nodiscard]] const DeviceSpec& spec() const noexcept override { return spec_; }
  /// Realtime: at most 200 substeps; a gap beyond 50 ms is skipped, not simulated.
  [[nodiscard]] DeviceState read(std::int64_t now_ns) noexcept override;
  void write(const Vec3d& force) noexcept override { write_wrench(force, Vec3d::Zero()); }
  void write_wrench(const Vec3d& force, const Vec3d& torque) noexcept override {
    force_ = force;
    torque_ = torque;
  }
  [[nodiscard]] DeviceHealth health() const noexcept override { return DeviceHealth::kReady; }

 private:
  [[nodiscard]] Vec3d tremor_at(std::int64_t time_ns) const noexcept;
  [[nodiscard]] Vec3d measured() noexcept;

  static constexpr int kTones = 3;
  struct Tone {
    double frequency, phase;  // rad/s, rad
  };

  DeviceSpec spec_;
  HandSettings settings_;
  Mailbox<HandPath> wishes_;
  HandPath path_;
  std::array<std::array<Tone, kTones>, 3> tremor_;
  std::minstd_rand random_;
  Vec3d position_, velocity_ = Vec3d::Zero(), force_ = Vec3d::Zero();
  Eigen::Quaterniond orientation_;
  Vec3d angular_velocity_ = Vec3d::Zero(), torque_ = Vec3d::Zero();
  Vec3d measured_position_, measured_velocity_ = Vec3d::Zero();
  std::int64_t time_ns_ = 0;
  bool started_ = false;
};

}  // namespace tactus::haptics
