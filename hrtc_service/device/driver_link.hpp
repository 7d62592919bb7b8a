/// The memory by which the HRTC and the process of a driver exchange poses and forces.
///
///     haptic thread                         tactus-device
///     DriverProcess -- newest command ----> DriverLoop --> driver
///                   <-- newest state ------
///
/// Each end checks what it reads, because a driver that writes to wrong addresses may also have written here.
#pragma once

#include <sys/types.h>

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "haptics/device.hpp"
#include "hrtc_service/servo/shared_mailbox.hpp"

namespace tactus::hrtc_service {

/// The driver's read should be done `kReadAheadNs` before the planned start of a cycle. From that start on, its process
/// polls for the command every `kPollNs`. Together they delay the force loop by about 0.15 ms more than a driver in the
/// haptic thread would, and the times of a read and a write come on top. This lowers the largest stable stiffness.
inline constexpr std::int64_t kReadAheadNs = 100'000, kPollNs = 50'000;

/// A force for the hand, in the device's frame.
struct DriverCommand {
  std::array<double, 3> force{}, torque{};  ///< N, N m
  std::int64_t cycle_ns = 0;                ///< start of the cycle that computed it
};

/// State of the device.
struct DriverState {
  haptics::DeviceState device;
  std::int64_t calls_ns = 0;  ///< mean time that the driver needs for a read and a write
  std::uint32_t failed = 0;   ///< not 0: the driver has reported a permanent failure
  /// Number of times that the stop button was pressed. If a press begins and ends between two reads of the HRTC, the
  /// newest state does not show it.
  std::uint32_t stops = 0;
  std::uint32_t refused = 0;  ///< number of commands that the device does not allow, which became zero force
};

struct DriverLink {
  static constexpr std::uint64_t kLayout = 4;  ///< increases when this struct or one of its parts changes

  // Written by the HRTC before the other process starts.
  std::uint64_t layout = kLayout;
  pid_t hrtc = 0;
  std::int64_t period_ns = 0;  ///< of the haptic thread

  std::atomic<std::uint32_t> is_ending{0};  ///< not 0: tactus-device should end

  // Written by tactus-device before it sets `is_open`, or before it ends with an error.
  haptics::DeviceSpec spec;
  std::array<char, 128> name{};
  std::array<char, 512> error{};          ///< the reason of a failure
  std::atomic<std::uint32_t> is_open{0};  ///< not 0: the driver has opened the device, and sent a first state

  SharedMailbox<DriverCommand> commands;
  SharedMailbox<DriverState> states;
};
static_assert(std::atomic<std::uint32_t>::is_always_lock_free && std::atomic<std::uint64_t>::is_always_lock_free,
              "used by two processes");

}  // namespace tactus::hrtc_service
