#include "realtime/periodic_clock.hpp"

namespace tactus::realtime {

PeriodicClock::PeriodicClock(std::int64_t period_ns) noexcept : period_{period_ns}, due_{monotonic_ns() + period_ns} {}

std::int64_t PeriodicClock::wait_next() noexcept {
  std::int64_t now = monotonic_ns();
  if (now - due_ > period_) {
    const std::int64_t missed = (now - due_) / period_;
    skipped_ += static_cast<std::uint64_t>(missed);
    due_ += missed * period_;
  }
  sleep_until(due_);
  now = monotonic_ns();
  const std::int64_t late = now - due_;
  due_ += period_;
  return late;
}

}  // namespace tactus::realtime
