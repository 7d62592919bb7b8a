/// Absolute deadlines for the haptic thread.
#pragma once

#include <cstdint>

#include "wire/realtime.hpp"

namespace tactus::hrtc_service {

using wire::monotonic_ns;

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
