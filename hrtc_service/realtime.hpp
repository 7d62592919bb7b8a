/// What the haptic thread asks of the system beside wire/realtime.hpp: its CPU time, and absolute deadlines.
#pragma once

#include <algorithm>
#include <cstdint>

#include "wire/realtime.hpp"

namespace tactus::hrtc_service {

using wire::monotonic_ns;

/// CPU time of the calling thread, ns. One system call, about 0.2 us.
[[nodiscard]] std::int64_t thread_cpu_ns() noexcept;

/// Whether a late cycle is late by its own work: CPU time and time passed since it woke both exceed half the period. (A
/// hypervisor's theft and interrupts count as the thread's CPU time; CPU time alone would include the wake-up.)
[[nodiscard]] inline bool own_work(std::int64_t cpu_ns, std::int64_t passed_ns, std::int64_t period_ns) noexcept {
  return std::min(cpu_ns, passed_ns) > period_ns / 2;
}

/// Sleeps to the next multiple of the period; deadlines are absolute, so lateness does not add up. When more than a
/// whole period was missed, the missed ticks are skipped and counted.
class PeriodicClock {
 public:
  explicit PeriodicClock(std::int64_t period_ns) noexcept;
  /// Returns how late the thread woke, ns.
  std::int64_t wait_next() noexcept;
  [[nodiscard]] std::int64_t due_ns() const noexcept { return due_; }
  [[nodiscard]] std::uint64_t skipped() const noexcept { return skipped_; }

 private:
  std::int64_t period_;
  std::int64_t due_;
  std::uint64_t skipped_ = 0;
};

}  // namespace tactus::hrtc_service
