/// Periodic wake-ups at absolute times, for the haptic thread.
#pragma once

#include <cstdint>

#include "realtime/realtime.hpp"

namespace tactus::realtime {

/// Wakes a thread once in each period. Due times are absolute, so delays do not add up. If the thread is late by more
/// than a period, the clock skips and counts the missed periods.
class PeriodicClock {
 public:
  explicit PeriodicClock(std::int64_t period_ns) noexcept;
  /// Sleeps until the next period, and returns the wake-up time minus the due time, ns.
  std::int64_t wait_next() noexcept;
  /// Returns the due time of the next period.
  [[nodiscard]] std::int64_t due_ns() const noexcept { return due_; }
  /// Returns the number of skipped periods.
  [[nodiscard]] std::uint64_t skipped() const noexcept { return skipped_; }

 private:
  std::int64_t period_;
  std::int64_t due_;
  std::uint64_t skipped_ = 0;
};

}  // namespace tactus::realtime
