/// A device on another machine, whose poses come over the network.
///
///     network thread            haptic thread         sender thread
///     on_pose --- mailbox --->  read                  on_command
///        ^ pose, and the command that was felt when it was taken      v command
///        +------------------------ the device ------------------------+
///
/// The newest pose counts. Its force goes out with the cycle's report, numbered by
/// `on_command`, so `write` does nothing here. What the surface's stiffness has to be cut to follows from the loop:
/// when a pose arrives, the force that its hand felt is so old. That includes both ways, losses on both and the waiting
/// at both ends, and needs one clock only, ours. World frame, SI.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

#include "haptics/device.hpp"
#include "haptics/mailbox.hpp"

namespace tactus::haptics {

/// A bound on a delay that varies: mean and four mean deviations, as TCP's timer has it (RFC 6298). It follows a rise
/// in 50 ms, within which no instability grows far, and a fall in 1 s, so that a stiffness made of it does not pump.
class LoopDelay {
 public:
  /// `seconds`: one delay seen; `dt`: since the one before.
  void add(double seconds, double dt) noexcept;
  [[nodiscard]] double value() const noexcept { return value_; }

  static constexpr double kUnknown = 0.25;  ///< s; until something is known

 private:
  static constexpr double kRise = 0.05, kFall = 1;  // s, time constants
  double mean_ = -1;                                // < 0: none yet
  double deviation_ = 0;
  double value_ = kUnknown;
};

/// A pose as it arrives; times of our own clock.
struct RemotePose {
  std::array<double, 3> position{0, 0, 0};
  std::array<double, 3> velocity{0, 0, 0};
  std::array<double, 4> orientation{0, 0, 0, 1};  ///< x, y, z, w
  std::uint32_t sequence = 0;
  std::uint32_t buttons = 0;
  std::uint32_t command_felt = 0;  ///< newest when the pose was taken; 0: none yet
  std::int64_t taken_ns = 0;       ///< as far as the session's clock tells
  std::int64_t arrived_ns = 0;
};

class RemoteDevice final : public Device {
 public:
  /// `spec` is what its maker vouches for.
  explicit RemoteDevice(const DeviceSpec& spec = {}) : spec_{spec} {}

  /// A pose that the window of its sender has accepted (session/sequence_window.hpp): it counts from now on. One
  /// network thread at a time.
  void on_pose(RemotePose pose) noexcept;
  /// A command leaves for the device with the force of the cycle that began at `cycle_ns`; gives its number, from 1.
  /// One sending thread.
  [[nodiscard]] std::uint32_t on_command(std::int64_t cycle_ns) noexcept;
  /// A pose has come; any thread.
  [[nodiscard]] bool has_pose() const noexcept { return has_pose_.load(std::memory_order_acquire); }
  /// s; any thread.
  [[nodiscard]] double loop_delay() const noexcept { return shown_loop_delay_.load(std::memory_order_relaxed); }

  [[nodiscard]] const DeviceSpec& spec() const noexcept override { return spec_; }
  /// Before the first pose: at the origin, as old as the clock. Realtime.
  [[nodiscard]] DeviceState read(std::int64_t now_ns) noexcept override;
  void write(const Vec3d&) noexcept override {}
  [[nodiscard]] DeviceHealth health() const noexcept override { return DeviceHealth::kReady; }

 private:
  static constexpr std::int64_t kOldest = 10'000'000'000;  // ns of transit; more is a clock that is wrong
  static constexpr std::uint32_t kRemembered = 1024;       // commands; older ones count as the oldest of these
  struct Mail {
    RemotePose pose;
    double loop_delay = LoopDelay::kUnknown;
  };

  [[nodiscard]] std::int64_t sent_ns(std::uint32_t command) const noexcept;

  DeviceSpec spec_;
  Mailbox<Mail> poses_;
  std::array<std::atomic<std::int64_t>, kRemembered> sent_ns_{};  // by command, modulo
  std::atomic<std::uint32_t> commands_{0};
  std::atomic<bool> has_pose_{false};
  std::atomic<double> shown_loop_delay_{LoopDelay::kUnknown};
  // The network thread's own.
  LoopDelay loop_delay_;
  std::int64_t newest_ns_ = 0;
  bool started_ = false;
};

}  // namespace tactus::haptics
