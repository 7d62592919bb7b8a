/// Real-time priority for timed code, and CPU time and page faults of the calling thread.
#pragma once

#include <sched.h>
#include <sys/resource.h>

#include <ctime>

namespace tactus::bench {

/// Gives the calling thread the priority of a haptic thread, if the system grants it. The destructor restores ordinary
/// priority. Threads that are started meanwhile inherit the priority.
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

  /// Returns the granted scheduling policy.
  [[nodiscard]] const char* text() const noexcept { return granted_ ? "SCHED_FIFO" : "no real-time priority"; }

 private:
  bool granted_;
};

/// Resources that the calling thread has used since its start.
struct ThreadUse {
  double cpu_us = 0;     ///< CPU time
  long faults = 0;       ///< number of page faults
  long preemptions = 0;  ///< number of involuntary context switches
};

/// Returns the CPU time of the calling thread, us.
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
