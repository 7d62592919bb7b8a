/// Operates a device by the commands of an HRTC.
///
///     sleep until kReadAheadNs before the next cycle --> read the state, send it
///           ^                                               |
///           |                                               v
///           +-- write the command of the cycle <---- sleep for kPollNs <--+
///           |                                               |             |
///           |                                               +-------------+  no command
///           +-- none for two cycles: go on without one; none for 10 ms: write zero force
///
/// So the driver's calls alternate as in a haptic thread. A force stays on the hand for at most 10 ms after the command,
/// plus the time that the driver takes for a call. The haptic thread wakes nobody, because that takes it some 20 us.
#pragma once

#include <atomic>
#include <cstdint>

#include "haptics/device.hpp"
#include "hrtc_service/device/driver_link.hpp"

namespace tactus::hrtc_service {

class DriverLoop {
 public:
  static constexpr std::int64_t kMaxSilenceNs = 10'000'000;  ///< from a command to zero force without another command

  /// Both must outlive the loop.
  DriverLoop(haptics::Device& device, DriverLink& link) noexcept;

  /// Sends the first state.
  void begin() noexcept { send_state(); }
  /// Returns after `stop` is set, with zero force. Allocates nothing.
  void run(const std::atomic<bool>& stop) noexcept;
  /// Returns a number that grows at least a hundred times a second, unless a call of the driver waits. Any thread.
  [[nodiscard]] std::uint32_t steps() const noexcept { return steps_.load(std::memory_order_relaxed); }

 private:
  void send_state() noexcept;
  [[nodiscard]] bool wait_for_command(std::int64_t cycle_ns) noexcept;
  void write_newest() noexcept;
  void write(const haptics::Vec3d& force, const haptics::Vec3d& torque) noexcept;

  haptics::Device& device_;
  const std::int64_t period_ns_;  // of the haptic thread
  MailboxReader<DriverCommand> commands_;
  MailboxWriter<DriverState> states_;
  DriverCommand command_;        // newest
  bool is_commanded_ = false;    // the last search has found a command
  bool exerts_force_ = false;    // the newest command was not zero
  std::int64_t written_ns_ = 0;  // time of the newest command
  std::atomic<std::uint32_t> steps_{0};
};

}  // namespace tactus::hrtc_service
