/// The priority that what is timed runs at: that of a haptic thread, where the system grants it.
#pragma once

#include <sched.h>

#include <ctime>

namespace tactus::bench {

/// SCHED_FIFO for the calling thread as long as it lives. Whatever the thread starts meanwhile inherits it.
class Priority {
 public:
  Priority() noexcept {
    sched_param wanted{};
    wanted.sched_priority = 20;
    granted_ = sched_setscheduler(0, SCHED_FIFO, &wanted) == 0;
  }
  ~Priority() {
    const sched_param usual{};
    if (granted_) sched_setscheduler(0, SCHED_OTHER, &usual);
  }
  Priority(const Priority&) = delete;
  Priority& operator=(const Priority&) = delete;

  [[nodiscard]] const char* text() const noexcept { return granted_ ? "SCHED_FIFO" : "no real-time priority"; }

 private:
  bool granted_;
};

/// What the calling thread has computed so far, us.
[[nodiscard]] inline double thread_cpu_us() noexcept {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}

}  // namespace tactus::bench
