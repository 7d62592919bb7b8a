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

class RemoteDevice final : public Device {
 public:
  /// `spec`: limits of the device, as its sender reports them.
  explicit RemoteDevice(const DeviceSpec& spec = {}) : spec_{spec} {}

  /// Sets the newest pose. A plausible window must have accepted it (session/sequence_window.hpp). One network thread
  /// at a time.
  void on_pose(RemotePose pose) noexcept;
  /// Registers a command with the force of the cycle that began at `cycle_ns`. Returns the number of the command,
  /// from 1. Sender thread only.
  [[nodiscard]] std::uint32_t on_command(std::int64_t cycle_ns) noexcept;
  /// True after the first pose; any thread.
  [[nodiscard]] bool has_pose() const noexcept { return has_pose_.load(std::memory_order_acquire); }
  /// Bound of the round trip, s; any thread.
  [[nodiscard]] double round_trip() const noexcept { return shown_round_trip_.load(std::memory_order_relaxed); }

  [[nodiscard]] const DeviceSpec& spec() const noexcept override { return spec_; }
  /// The newest pose; before the first: the origin, with time 0. Realtime.
  [[nodiscard]] DeviceState read(std::int64_t now_ns) noexcept override;
  void write(const Vec3d&) noexcept override {}
  [[nodiscard]] DeviceHealth health() const noexcept override { return DeviceHealth::kReady; }

 private:
  static constexpr std::int64_t kOldest = 10'000'000'000;  // ns, max transit; a longer one means that a clock is wrong
  static constexpr std::uint32_t kStoredCommands =
      1024;  // commands whose time is stored; a command older than the last 512 counts as 512 commands old
  struct Mail {
    RemotePose pose;
    double round_trip = RoundTripBound::kUnknown;
  };

  [[nodiscard]] std::int64_t sent_ns(std::uint32_t command) const noexcept;

  DeviceSpec spec_;
  Mailbox<Mail> poses_;
  std::array<std::atomic<std::int64_t>, kStoredCommands> sent_ns_{};  // by command modulo kStoredCommands
  std::atomic<std::uint32_t> commands_{0};
  std::atomic<bool> has_pose_{false};
  std::atomic<double> shown_round_trip_{RoundTripBound::kUnknown};
  // Used by the network thread only.
  RoundTripBound round_trip_;
  std::int64_t newest_ns_ = 0;
  bool started_ = false;
};

}  // namespace tactus::haptics
