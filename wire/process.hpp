/// What every program of a session asks of the system: the time, and when to stop.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>

namespace tactus::wire {

/// CLOCK_MONOTONIC, of which all times of a program are, ns. Answered without a system call. Realtime.
[[nodiscard]] inline std::int64_t monotonic_ns() noexcept {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

/// Set by SIGINT and SIGTERM from the first call on, which is main's before it does anything that takes time. It is for
/// the program to look at it often enough to end within 2 s.
[[nodiscard]] const std::atomic<bool>& stop_signal();

/// How often SIGUSR1 has come, from the first call on: by it an operator asks for what a program keeps to be saved.
[[nodiscard]] const std::atomic<std::uint32_t>& save_signals();

}  // namespace tactus::wire
