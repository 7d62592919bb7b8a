#include "realtime/realtime.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <xmmintrin.h>

#include <cerrno>
#include <cstring>
#include <ctime>

namespace tactus::realtime {
namespace {

void touch_stack() noexcept {
  constexpr std::size_t kBytes = 256 * 1024;
  unsigned char stack[kBytes];
  for (std::size_t i = 0; i < kBytes; i += 4096) stack[i] = 0;
  asm volatile("" : : "r"(stack) : "memory");  // so that the compiler does not remove the writes
}

}  // namespace

std::string enter_realtime(const std::string& who, int priority) {
  touch_stack();
  // Treats denormals as zero: each costs hundreds of processor cycles and has no physical meaning.
  _mm_setcsr(_mm_getcsr() | 0x8040);
  sched_param parameters{};
  parameters.sched_priority = priority;
  const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
  if (error == 0) return who + ": SCHED_FIFO " + std::to_string(priority);
  return who + ": no real-time priority (" + std::strerror(error) + "); cycles will be less steady; see tactus doctor";
}

std::string raise_priority(const std::string& who) {
  constexpr int kNice = -10;
  if (setpriority(PRIO_PROCESS, 0, kNice) == 0) return who + ": nice " + std::to_string(kNice);  // 0: this thread
  return who + ": no raised priority (" + std::strerror(errno) +
         "); this counts if many HRTCs share this machine; see tactus doctor";
}

std::string lock_memory() {
  if (mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0) return "memory: locked";
  return std::string("memory: not locked (") + std::strerror(errno) +
         "); page faults may delay a cycle; see tactus doctor";
}

void sleep_until(std::int64_t due_ns) noexcept {
  constexpr std::int64_t kNsPerS = 1'000'000'000;
  const timespec until{due_ns / kNsPerS, due_ns % kNsPerS};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

}  // namespace tactus::realtime
