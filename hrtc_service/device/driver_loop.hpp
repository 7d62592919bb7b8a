/// Operates a device by the commands of an HRTC.
///
///     sleep until shortly before the next cycle --> read the state, send it --> poll for the command of the cycle
///           ^                                                                     |                 |
///           +--------------------------- write its force <------------------------+                 | none
///           +--------------------------- write zero force, if the timeout is over <-----------------+
///
/// A force stays on the hand until `timeout_ns` after the start of the cycle that computed it, plus the time that the
/// driver takes for a call. After a timeout, the forces grow from zero to full within 0.1 s. The haptic thread does not
/// wake this process, because a wake-up costs it some 20 us.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>

#include "haptics/device.hpp"
#include "hrtc_service/device/driver_link.hpp"

namespace tactus::hrtc_service {

class DriverLoop {
 public:
  /// Both must outlive the loop.
  DriverLoop(haptics::Device& device, DriverLink& link) noexcept;

  /// Sends the first state.
  void begin() noexcept { send_state(); }
  /// Returns after DriverLink::is_ending is set, with zero force. Allocates nothing.
  void run() noexcept;
  /// Returns a number that grows at least every three periods, unless a call of the driver waits. Any thread.
  [[nodiscard]] std::uint32_t steps() const noexcept { return steps_.load(std::memory_order_relaxed); }

  /// Returns the time from the start of the newest cycle with a command to zero force: 10 ms, or three slow periods.
  [[nodiscard]] static constexpr std::int64_t timeout_ns(std::int64_t period_ns) noexcept {
    return std::max<std::int64_t>(10'000'000, 3 * period_ns);
  }

 private:
  void send_state() noexcept;
  [[nodiscard]] bool is_allowed(const haptics::Vec3d& force, const haptics::Vec3d& torque) const noexcept;
  [[nodiscard]] bool wait_for_command(std::int64_t cycle_ns) noexcept;
  void write_command() noexcept;
  [[nodiscard]] std::int64_t planned_start() noexcept;

  haptics::Device& device_;
  const std::atomic<std::uint32_t>& is_ending_;
  const std::int64_t period_ns_;  // of the haptic thread
  const std::int64_t timeout_ns_;
  MailboxReader<DriverCommand> commands_;
  MailboxWriter<DriverState> states_;
  DriverCommand command_;        // newest
  bool is_commanded_ = false;    // the last cycle had a command
  bool is_stopped_ = false;      // the stop button was pressed in the last read
  std::uint32_t stops_ = 0;      // number of its presses
  std::uint32_t refused_ = 0;    // number of commands that the device does not allow
  double strength_ = 0;          // 0 to 1: share of the commanded force
  std::int64_t read_ns_ = 0;     // mean time of a read
  std::int64_t write_ns_ = 0;    // mean time of a write of a command
  std::int64_t cycle_ns_ = 0;    // start of the newest cycle with a command
  std::int64_t planned_ns_ = 0;  // start that was planned for that cycle
  std::atomic<std::uint32_t> steps_{0};
};

}  // namespace tactus::hrtc_service
