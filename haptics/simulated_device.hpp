/// Simulates a hand and the device that it holds, for simulated users.
///
///     hand's target --[ spring, damper ]-- device's mass --[ damper ]-- ground
///                                            ^ force of the surface
///
/// The device rotates by a spring to the hand's target orientation (the wrist), a damper to ground, and an inertia that
/// is equal about all axes.
/// Device frame, SI. `read` advances the simulation to the given time, with the wrench last written.
#pragma once

#include <array>
#include <cstdint>
#include <random>

#include "haptics/device.hpp"
#include "haptics/mailbox.hpp"

namespace tactus::haptics {

inline constexpr std::size_t kMaxHandWaypoints = 16;

/// Target path of a hand: linear between waypoints of ascending time, constant before the first and after the last.
struct HandPath {
  struct Waypoint {
    std::int64_t time_ns;
    std::array<double, 3> position;
    std::array<double, 4> orientation{0, 0, 0, 1};  ///< unit quaternion x, y, z, w
  };
  std::array<Waypoint, kMaxHandWaypoints> waypoints{};
  std::uint32_t count = 0;    ///< 0: no path; the hand continues on its previous path
  std::uint32_t buttons = 0;  ///< Button, pressed during the path

  /// Target position and velocity at a time; `count` must not be 0. Realtime.
  void at(std::int64_t time_ns, Vec3d& position, Vec3d& velocity) const noexcept;
  /// Target orientation at a time. Realtime.
  [[nodiscard]] Eigen::Quaterniond orientation_at(std::int64_t time_ns) const noexcept;

 private:
  /// The waypoints before and after a time. Before the first and after the last waypoint both are the same.
  struct Segment {
    const Waypoint *from, *to;
    double share, rate;  // share of the segment, 0 at `from` and 1 at `to`; its rate of change, 1/s
  };
  [[nodiscard]] Segment segment_at(std::int64_t time_ns) const noexcept;
};

struct HandSettings {
  double mass = 0.2;            ///< kg, mass of the device
  double hand_stiffness = 250;  ///< N/m
  double hand_damping = 5;      ///< N s/m
  double tremor = 0;            ///< m, root mean square of the target's 8-12 Hz tremor
  double noise = 0;             ///< m, standard deviation of a position reading
  double encoder_step = 0;      ///< m; 0: continuous
  std::uint32_t seed = 1;       ///< seed of tremor and noise
  Vec3d start = Vec3d::Zero();  ///< position of the hand until its first path
  Eigen::Quaterniond start_orientation =
      Eigen::Quaterniond::Identity();  ///< orientation of the hand until its first path
  double inertia = 2e-4;               ///< kg m^2, inertia of the device about its tip
  double wrist_stiffness = 1;          ///< N m/rad
  double wrist_damping = 0.03;         ///< N m s
};

class SimulatedDevice final : public Device {
 public:
  explicit SimulatedDevice(const HandSettings& settings = {}, const DeviceSpec& spec = {});

  /// Mailbox for the paths of the hand, which one other thread posts. Times are of the clock given to `read`.
  [[nodiscard]] Mailbox<HandPath>& paths() noexcept { return paths_; }

  [[nodiscard]] const DeviceSpec& spec() const noexcept override { return spec_; }
  /// Realtime: at most 200 substeps. If more than 50 ms have passed, only the last 50 ms are simulated.
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
  Mailbox<HandPath> paths_;
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
