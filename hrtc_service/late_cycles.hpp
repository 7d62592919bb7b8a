/// Finds out why a cycle of a periodic thread was late, from the counters of the system for that thread.
///
///     periodic thread --- CycleTimes of each cycle ------------+
///                                                              v
///     any other thread --- UsageSampler --- ThreadUsage ---> LateCycleClassifier ---> overrun, preempted or unknown
///
/// The periodic thread itself makes no system call for this. Another thread reads its counters every few milliseconds;
/// the classifier takes the differences between two readings around a late cycle and subtracts the shares of the other
/// cycles between them. The result is an interval, and the cycle gets a class only when the whole interval is on one
/// side of the limit.
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

/// The times of one cycle, ns of monotonic_ns().
struct CycleTimes {
  std::int64_t due_ns = 0;       ///< planned start
  std::int64_t began_ns = 0;     ///< wake-up
  std::int64_t end_ns = 0;       ///< end of its work
  std::int64_t deadline_ns = 0;  ///< planned start of the next cycle

  [[nodiscard]] bool late() const noexcept { return end_ns > deadline_ns; }
};

/// The system's counters for a thread since its start.
struct ThreadUsage {
  std::int64_t counted_ns = 0;  ///< earliest time at which the counts were read
  std::int64_t time_ns = 0;     ///< time at which the times were read, after the counts
  std::int64_t cpu_ns = 0;      ///< time on a processor
  std::int64_t wait_ns = 0;     ///< runnable while another thread ran (run-queue wait)
  bool asleep = false;          ///< at the time of the counts, which include its last sleep
  std::uint64_t voluntary = 0;  ///< context switches by blocking, sleeps included
  std::uint64_t involuntary = 0;
  std::uint64_t minor_faults = 0, major_faults = 0;
};

/// Reads the usage of another thread of this process. The constructor and `drain` belong to one thread, `sample` to one
/// thread, which may be a third. Sources: proc(5), pthread_getcpuclockid(3).
class UsageSampler {
 public:
  /// The thread must run; it may end before the sampler does.
  UsageSampler(pthread_t thread, pid_t thread_id);
  ~UsageSampler();
  UsageSampler(const UsageSampler&) = delete;
  UsageSampler& operator=(const UsageSampler&) = delete;

  /// False where the system reports nothing (no /proc, or a kernel without CONFIG_SCHED_INFO).
  [[nodiscard]] bool available() const { return read().has_value(); }

  /// Reads the counters when the last reading is kPeriodNs old; the system calls take some 15 us. A reading while the
  /// thread is awake would be less certain, so the sampler then waits for a later call, until the last reading is
  /// kLongestNs old.
  void sample(std::int64_t now_ns);
  static constexpr std::int64_t kPeriodNs = 4'000'000, kLongestNs = 20'000'000;

  /// Passes the readings since the last call to `take`.
  template <class Take>
  void drain(Take&& take) {
    for (ThreadUsage usage; usages_.pop(usage);) take(usage);
  }

 private:
  struct Reading {
    ThreadUsage usage;
    bool brief = false;  ///< its figures belong together: the reader was not interrupted between them
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

/// A late cycle and the figures by which it was classified.
struct LateVerdict {
  LateClass late_class = LateClass::kUnknown;
  CycleTimes times;
  std::int64_t own_ns = 0;  ///< minimum time for which it computed or was blocked
  // Between the two readings, including the other cycles there.
  std::int64_t cpu_ns = 0, wait_ns = 0;
  std::uint64_t blocked = 0;  ///< count of blockings, sleeps not included
  std::uint64_t minor_faults = 0, major_faults = 0;
};

/// Classifies late cycles. Cycles must come in the order of their times, and so must readings; the order between the
/// two does not matter. Gives one verdict for each late cycle, in order. One thread at a time; allocates.
class LateCycleClassifier {
 public:
  void add(const CycleTimes& cycle);
  void add(const ThreadUsage& usage) { usages_.push_back(usage); }
  /// The next verdict that readings on both sides of its cycle allow.
  [[nodiscard]] std::optional<LateVerdict> next();
  /// Ends the input: `next` then gives a verdict for every remaining late cycle.
  void finish() noexcept { finished_ = true; }

 private:
  struct Cycle {
    CycleTimes times;
    std::int64_t previous_end_ns = 0;

    /// The cycle before still ran when this one was due, so there was no sleep.
    [[nodiscard]] bool follows_at_once() const noexcept { return previous_end_ns >= times.due_ns; }
    /// The delay by the previous cycle.
    [[nodiscard]] std::int64_t delay_ns() const noexcept {
      return follows_at_once() ? previous_end_ns - times.due_ns : 0;
    }
    [[nodiscard]] std::int64_t start_ns() const noexcept { return std::max(previous_end_ns, times.due_ns); }
  };

  [[nodiscard]] LateVerdict judge(const Cycle& late, const ThreadUsage& before, const ThreadUsage& after) const;
  void forget_before(std::int64_t time_ns);

  std::deque<Cycle> cycles_;  // that later readings or pending verdicts may need
  std::deque<Cycle> late_;
  std::deque<ThreadUsage> usages_;
  std::optional<CycleTimes> newest_;
  LateClass last_class_ = LateClass::kUnknown;  // of the last verdict
  bool finished_ = false;
};

}  // namespace tactus::hrtc_service
