/// Represents a device on another machine, whose poses arrive over the network.
///
///     network thread            haptic thread         sender thread
///     on_pose --- mailbox --->  read                  on_command
///        ^ pose, and the newest command that the device had applied     v command
///        +------------------------ the device ------------------------+
///
/// `read` returns the newest pose. `write` does nothing, because the sender thread reads the force from the report of
/// the cycle and numbers the command by `on_command`. The round trip limits the stiffness. It is measured when a pose
/// arrives, as the age of the newest command that the device had applied when it took the pose. This age includes both
/// directions, losses and waiting at both ends, and needs only the clock of the HRTC. World frame, SI.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

#include "haptics/device.hpp"
#include "haptics/mailbox.hpp"

namespace tactus::haptics {

/// An upper bound of a varying delay: mean plus four mean deviations, as in TCP's retransmission timer (RFC 6298). The
/// bound follows a rise with a time constant of 50 ms, before an instability can grow, and a fall with one of 1 s, so
/// that the stiffness does not oscillate.
class RoundTripBound {
 public:
  /// Adds a measured delay, s. `dt`: time since the previous measurement, s.
  void add(double seconds, double dt) noexcept;
  /// The bound, s.
  [[nodiscard]] double value() const noexcept { return value_; }

  static constexpr double kUnknown = 0.25;  ///< s, the bound before the first measurement

 private:
  static constexpr double kRise = 0.05, kFall = 1;  // s, time constants of the bound
  double mean_ = -1;                                // < 0: no measurement yet
  double deviation_ = 0;
  double value_ = kUnknown;
};

/// A received pose. Times are of the HRTC's clock.
struct RemotePose {
  std::array<double, 3> position{0, 0, 0};
  std::array<double, 3> velocity{0, 0, 0};
  std::array<double, 4> orientation{0, 0, 0, 1};  ///< x, y, z, w
  std::uint32_t sequence = 0;
  std::uint32_t buttons = 0;
  std::uint32_t command_applied = 0;  ///< number of the newest command that the device had applied; 0: none
  std::int64_t measured_ns = 0;       ///< time of the measurement, estimated by the session clock
  std::int64_t arrived_ns = 0;
};

/// A pose with the bound of the round trip when it arrived, s.
struct TimedPose {
  RemotePose pose;
  double round_trip = RoundTripBound::kUnknown;
};

/// Returns the state of the device. Realtime.
[[nodiscard]] DeviceState state_of(const TimedPose& timed) noexcept;

/// Measures the round trip to the device.
class RemoteTiming {
 public:
  /// Bounds the transit of a pose, and adds the round trip. A plausible window must have accepted the pose
  /// (session/sequence_window.hpp). One network thread at a time.
  [[nodiscard]] TimedPose on_pose(RemotePose pose) noexcept;
  /// Registers a command with the force of the cycle that began at `cycle_ns`. Returns the number of the command,
  /// from 1. Sender thread only.
  [[nodiscard]] std::uint32_t on_command(std::int64_t cycle_ns) noexcept;
  /// True after the first pose; any thread.
  [[nodiscard]] bool has_pose() const noexcept { return has_pose_.load(std::memory_order_acquire); }
  /// Bound of the round trip, s; any thread.
  [[nodiscard]] double round_trip() const noexcept { return shown_round_trip_.load(std::memory_order_relaxed); }

  /// A longer transit means that a clock is wrong, so it is cut to this, ns.
  static constexpr std::int64_t kMaxTransitNs = 10'000'000'000;

 private:
  static constexpr std::uint32_t kStoredCommands =
      1024;  // commands whose time is stored; a command older than the last 512 counts as 512 commands old

  [[nodiscard]] std::int64_t sent_ns(std::uint32_t command) const noexcept;

  std::array<std::atomic<std::int64_t>, kStoredCommands> sent_ns_{};  // by command modulo kStoredCommands
  std::atomic<std::uint32_t> commands_{0};
  std::atomic<bool> has_pose_{false};
  std::atomic<double> shown_round_trip_{RoundTripBound::kUnknown};
  // Used by the network thread only.
  RoundTripBound round_trip_;
  std::int64_t newest_ns_ = 0;
  bool started_ = false;
};

/// The device for a haptic thread in the process that receives the poses.
class RemoteDevice final : public Device {
 public:
  /// `spec`: limits of the device, as its sender reports them.
  explicit RemoteDevice(const DeviceSpec& spec = {}) : spec_{spec} {}

  // As in RemoteTiming. `on_pose` also makes the pose the newest.
  void on_pose(const RemotePose& pose) noexcept { poses_.post(timing_.on_pose(pose)); }
  [[nodiscard]] std::uint32_t on_command(std::int64_t cycle_ns) noexcept { return timing_.on_command(cycle_ns); }
  [[nodiscard]] bool has_pose() const noexcept { return timing_.has_pose(); }
  [[nodiscard]] double round_trip() const noexcept { return timing_.round_trip(); }

  [[nodiscard]] const DeviceSpec& spec() const noexcept override { return spec_; }
  /// The newest pose; before the first: the origin, with time 0. Realtime.
  [[nodiscard]] DeviceState read(std::int64_t) noexcept override { return state_of(poses_.latest()); }
  void write(const Vec3d&) noexcept override {}
  [[nodiscard]] DeviceHealth health() const noexcept override { return DeviceHealth::kReady; }

 private:
  DeviceSpec spec_;
  RemoteTiming timing_;
  Mailbox<TimedPose> poses_;
};

}  // namespace tactus::haptics
