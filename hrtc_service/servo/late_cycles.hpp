/// Classifies late cycles of a periodic thread by the system's counters for that thread.
///
///     periodic thread --- CycleTimes of each cycle ------------+
///                                                              v
///     any other thread --- UsageSampler --- ThreadUsage ---> LateCycleClassifier ---> overrun, preempted or unknown
///
/// The periodic thread itself makes no system call for this. Another thread reads its counters every few milliseconds.
/// The classifier computes the difference of the readings before and after a late cycle, and subtracts the times of the
/// other cycles between these readings. Because a reading is not taken exactly at the start or end of a cycle, the
/// result is an interval. The cycle gets a class only if the whole interval is above or below the limit of the class.
#pragma once

#include <pthread.h>
#include <sys/types.h>

#include <algorithm>
#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <ctime>
#include <deque>
#include <optional>

namespace tactus::hrtc_service {

/// The times of one cycle, ns of realtime::monotonic_ns().
struct CycleTimes {
  std::int64_t due_ns = 0;       ///< planned start
  std::int64_t began_ns = 0;     ///< wake-up
  std::int64_t end_ns = 0;       ///< end of its work
  std::int64_t deadline_ns = 0;  ///< planned start of the next cycle

  [[nodiscard]] bool late() const noexcept { return end_ns > deadline_ns; }
};

/// The system's counters for a thread since its start.
struct ThreadUsage {
  std::int64_t counted_ns = 0;  ///< start of reading the counts: switches and faults
  std::int64_t time_ns = 0;     ///< time of reading `cpu_ns` and `wait_ns`, after the counts
  std::int64_t cpu_ns = 0;      ///< time on a processor
  std::int64_t wait_ns = 0;     ///< run-queue wait: time in which the thread was runnable while another one ran
  bool asleep = false;          ///< the thread slept when the counts were read, and they include this sleep
  std::uint64_t voluntary = 0;  ///< context switches because the thread blocked or slept
  std::uint64_t involuntary = 0;
  std::uint64_t minor_faults = 0, major_faults = 0;
};

/// Reads the usage of another thread of this process. One thread calls the constructor and `drain`; one thread, which
/// may be another, calls `sample`. Sources: proc(5), pthread_getcpuclockid(3).
class UsageSampler {
 public:
  /// The thread must be running. It may end before the sampler does.
  UsageSampler(pthread_t thread, pid_t thread_id);
  ~UsageSampler();
  UsageSampler(const UsageSampler&) = delete;
  UsageSampler& operator=(const UsageSampler&) = delete;

  /// Returns whether the system has these counters. They need /proc and a kernel with CONFIG_SCHED_INFO.
  [[nodiscard]] bool available() const { return read().has_value(); }

  /// Reads the counters if the last stored reading is at least kPeriodNs old. The system calls take some 15 us. A
  /// reading while the thread is awake is less certain. It is stored only if the last stored one is at least
  /// kMaxPeriodNs old.
  void sample(std::int64_t now_ns);
  static constexpr std::int64_t kPeriodNs = 4'000'000, kMaxPeriodNs = 20'000'000;

  /// Passes the readings since the last call to `consume`.
  template <class Consume>
  void drain(Consume&& consume) {
    for (ThreadUsage usage; usages_.pop(usage);) consume(usage);
  }

 private:
  struct Reading {
    ThreadUsage usage;
    bool is_consistent = false;  ///< all counters were read within a short time
  };
  [[nodiscard]] std::optional<Reading> read() const;
  [[nodiscard]] bool read_counts(ThreadUsage& usage) const;
  [[nodiscard]] bool read_times(Reading& reading) const;

  clockid_t cpu_clock_{};
  int status_ = -1, stat_ = -1, schedstat_ = -1;  // files of /proc/self/task
  std::int64_t sampled_ns_ = 0;
  boost::lockfree::spsc_queue<ThreadUsage> usages_{1024};
};

enum class LateClass : std::uint8_t {
  kOverrun,    ///< the thread itself computed or was blocked for more than half the period
  kPreempted,  ///< other threads ran while it was runnable, for at least as long as the cycle was late
  kUnknown     ///< neither is certain: a late timer, a hypervisor, or no readings around the cycle
};

/// A late cycle, its class, and the measurements for it.
struct LateVerdict {
  LateClass late_class = LateClass::kUnknown;
  CycleTimes times;
  std::int64_t own_ns = 0;  ///< min time for which the thread itself computed or was blocked in this cycle
  // Differences between the readings before and after the cycle. They include the other cycles between these readings.
  std::int64_t cpu_ns = 0, wait_ns = 0;
  std::uint64_t blocked = 0;  ///< number of times that the thread blocked, without sleeps
  std::uint64_t minor_faults = 0, major_faults = 0;
};

/// Classifies late cycles. Cycles must be added in the order of their times, and readings as well. The order between
/// cycles and readings does not matter. Returns one verdict for each late cycle, in order. A cycle that is late only
/// because the previous cycle ended late gets the class of the previous verdict. One thread at a time. Allocates.
class LateCycleClassifier {
 public:
  void add(const CycleTimes& cycle);
  void add(const ThreadUsage& usage) { usages_.push_back(usage); }
  /// Returns the next verdict, if there are readings before and after its cycle.
  [[nodiscard]] std::optional<LateVerdict> next();
  /// Ends the input. `next` then returns a verdict for every remaining late cycle.
  void finish() noexcept { finished_ = true; }

 private:
  struct Cycle {
    CycleTimes times;
    std::int64_t previous_end_ns = 0;

    /// Returns whether the previous cycle still ran when this one was due, so that the thread did not sleep.
    [[nodiscard]] bool follows_without_sleep() const noexcept { return previous_end_ns >= times.due_ns; }
    /// Returns the delay of the start by the previous cycle.
    [[nodiscard]] std::int64_t delay_ns() const noexcept {
      return follows_without_sleep() ? previous_end_ns - times.due_ns : 0;
    }
    [[nodiscard]] std::int64_t start_ns() const noexcept { return std::max(previous_end_ns, times.due_ns); }
  };

  [[nodiscard]] LateVerdict classify(const Cycle& late, const ThreadUsage& before, const ThreadUsage& after) const;
  void drop_before(std::int64_t time_ns);

  std::deque<Cycle> cycles_;  // cycles that later readings or pending verdicts may need
  std::deque<Cycle> late_;    // late cycles without a verdict
  std::deque<ThreadUsage> usages_;
  std::optional<CycleTimes> newest_;
  LateClass last_class_ = LateClass::kUnknown;  // class of the last verdict
  bool finished_ = false;
};

}  // namespace tactus::hrtc_service
