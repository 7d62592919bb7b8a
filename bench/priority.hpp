/// The priority that what is timed runs at: that of a haptic thread, where the system grants it.
#pragma once

#include <sched.h>
#include <sys/resource.h>

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

/// What of the calling thread the system has seen so far.
struct ThreadUse {
  double cpu_us = 0;     ///< computed
  long faults = 0;       ///< pages that were mapped but not there, or not yet
  long preemptions = 0;  ///< times that something else took its processor
};

/// What the calling thread has computed so far, us.
[[nodiscard]] inline double thread_cpu_us() noexcept {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e6 + static_cast<double>(now.tv_nsec) * 1e-3;
}

[[nodiscard]] inline ThreadUse thread_use() noexcept {
  rusage used{};
  getrusage(RUSAGE_THREAD, &used);
  return {thread_cpu_us(), used.ru_minflt + used.ru_majflt, used.ru_nivcsw};
}

}  // namespace tactus::bench
