/// System functions that every program of a session uses: the clock and the signals.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

namespace tactus::wire {

/// CLOCK_MONOTONIC, the clock of all times in a program, ns. No system call. Realtime.
[[nodiscard]] inline std::int64_t monotonic_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// Set by SIGINT and SIGTERM. The first call installs the handler, so main calls it before anything that takes time.
/// The program has to poll it often enough to end within 2 s.
[[nodiscard]] const std::atomic<bool>& stop_signal();

/// Counts SIGUSR1, by which an operator requests that recorded data is saved. The first call installs the handler.
[[nodiscard]] const std::atomic<std::uint32_t>& save_signals();

}  // namespace tactus::wire
