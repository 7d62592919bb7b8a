#include "hrtc_service/realtime.hpp"

#include <ctime>

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;

}  // namespace

std::int64_t thread_cpu_ns() noexcept {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return now.tv_sec * kNsPerS + now.tv_nsec;
}

PeriodicClock::PeriodicClock(std::int64_t period_ns) noexcept : period_{period_ns}, due_{monotonic_ns() + period_ns} {}

std::int64_t PeriodicClock::wait_next() noexcept {
  std::int64_t now = monotonic_ns();
  if (now - due_ > period_) {
    const std::int64_t missed = (now - due_) / period_;
    skipped_ += static_cast<std::uint64_t>(missed);
    due_ += missed * period_;
  }
  wire::sleep_until(due_);
  now = monotonic_ns();
  const std::int64_t late = now - due_;
  due_ += period_;
  return late;
}

}  // namespace tactus::hrtc_service
