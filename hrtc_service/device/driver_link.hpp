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

/// The driver reads the device this time before the planned start of a cycle. From then on it searches for the command
/// of the cycle at times with this distance, so that the haptic thread need not wake it. So the loop has about the sum of
/// both as a round trip, beyond that of a driver in the haptic thread. It lowers the stiffness that is stable.
inline constexpr std::int64_t kReadAheadNs = 100'000, kPollNs = 50'000;

/// A force for the hand, in the device's frame.
struct DriverCommand {
  std::array<double, 3> force{}, torque{};  ///< N, N m
  std::int64_t cycle_ns = 0;                ///< start of the cycle that computed it
};

/// State of the device.
struct DriverState {
  haptics::DeviceState device;
  std::uint32_t failed = 0;  ///< not 0: the driver has reported a permanent failure
};

struct DriverLink {
  static constexpr std::uint64_t kLayout = 1;  ///< increases when this struct changes

  // Written by the HRTC before the other process starts.
  std::uint64_t layout = kLayout;
  pid_t hrtc = 0;
  std::int64_t period_ns = 0;  ///< of the haptic thread

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
