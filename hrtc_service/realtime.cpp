#include "hrtc_service/realtime.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <xmmintrin.h>

#include <cerrno>
#include <cstring>
#include <ctime>

namespace tactus::hrtc_service {
namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;

void touch_stack() noexcept {
  constexpr std::size_t kBytes = 256 * 1024;
  unsigned char stack[kBytes];
  for (std::size_t i = 0; i < kBytes; i += 4096) stack[i] = 0;
  asm volatile("" : : "r"(stack) : "memory");  // or the writes would be left out
}

}  // namespace

std::int64_t thread_cpu_ns() noexcept {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return now.tv_sec * kNsPerS + now.tv_nsec;
}

std::string enter_realtime(int priority) {
  touch_stack();
  // Denormals cost hundreds of cycles each and mean nothing here.
  _mm_setcsr(_mm_getcsr() | 0x8040);
  sched_param parameters{};
  parameters.sched_priority = priority;
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
  if (error == 0) return "haptic thread: SCHED_FIFO " + std::to_string(priority);
  return std::string("haptic thread: no real-time priority (") + std::strerror(error) +
         "); give the user rtprio in /etc/security/limits.conf or run as root for steadier cycles";
}

std::string lock_memory() {
  if (mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0) return "memory: locked";
  return std::string("memory: not locked (") + std::strerror(errno) +
         "); raise memlock in /etc/security/limits.conf, or page faults may delay a cycle";
}

PeriodicClock::PeriodicClock(std::int64_t period_ns) noexcept : period_{period_ns}, due_{monotonic_ns() + period_ns} {}

std::int64_t PeriodicClock::wait_next() noexcept {
  std::int64_t now = monotonic_ns();
  if (now - due_ > period_) {
    const std::int64_t missed = (now - due_) / period_;
    skipped_ += static_cast<std::uint64_t>(missed);
    due_ += missed * period_;
  }
  const timespec until{due_ / kNsPerS, due_ % kNsPerS};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
  now = monotonic_ns();
  const std::int64_t late = now - due_;
  due_ += period_;
  return late;
}

}  // namespace tactus::hrtc_service
