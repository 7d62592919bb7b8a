/// The clock and the signals of a program.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

namespace tactus::realtime {

/// Time of CLOCK_MONOTONIC, the clock of all times in a program, ns. No system call. Realtime.
[[nodiscard]] inline std::int64_t monotonic_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// Returns a flag that SIGINT and SIGTERM set. The first call installs the handler, so main calls it before all work
/// that takes time. The program has to read the flag often enough to end within 2 s.
[[nodiscard]] const std::atomic<bool>& stop_signal();

/// Delays SIGUSR1 and SIGUSR2 until the next two functions are called. The delay continues after exec().
void delay_user_signals();

/// Returns the number of SIGUSR2 signals, each of which requests an emergency stop at this program. The first call
/// installs the handler. Without it, the signal ends the program, so main calls this before all work that takes time.
[[nodiscard]] const std::atomic<std::uint32_t>& emergency_stop_signals();

/// Returns the number of SIGUSR1 signals, each of which requests that recorded data is saved. The first call installs
/// the handler, like `emergency_stop_signals`.
[[nodiscard]] const std::atomic<std::uint32_t>& save_signals();

}  // namespace tactus::realtime
