/// Finds the times in which the main thread of another process works without waiting.
#pragma once

#include <fcntl.h>
#include <sys/types.h>
#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "realtime/realtime.hpp"
#include "session/units.hpp"

namespace tactus::bench {

/// A thread samples the state of the main thread of a process every 0.2 ms. A thread that does not sleep is busy, also
/// while others preempt it.
class BusyThread {
 public:
  struct Interval {
    std::int64_t begin_ns, end_ns;  // first and last of successive samples that found the thread busy
  };

  explicit BusyThread(pid_t process)
      : file_{::open(("/proc/" + std::to_string(process) + "/stat").c_str(), O_RDONLY | O_CLOEXEC)} {
    if (file_ < 0) throw std::runtime_error{"cannot read the state of process " + std::to_string(process)};
    sampler_ = std::thread{[this] { sample(); }};
  }
  ~BusyThread() {
    stop_ = true;
    sampler_.join();
    ::close(file_);
  }
  BusyThread(const BusyThread&) = delete;
  BusyThread& operator=(const BusyThread&) = delete;

  /// Forgets the intervals that have ended.
  void forget() {
    const std::lock_guard lock{mutex_};
    if (intervals_.size() > 1) intervals_.erase(intervals_.begin(), intervals_.end() - 1);
  }
  /// Returns the interval that contains this time, as far as it has been sampled.
  [[nodiscard]] std::optional<Interval> at(std::int64_t time_ns) const {
    const std::lock_guard lock{mutex_};
    for (const Interval& interval : intervals_)
      if (interval.begin_ns <= time_ns && time_ns <= interval.end_ns) return interval;
    return std::nullopt;
  }
  /// Returns the interval that contains the newest sample; none if that sample found the thread waiting.
  [[nodiscard]] std::optional<Interval> now() const {
    const std::lock_guard lock{mutex_};
    return was_busy_ ? std::optional{intervals_.back()} : std::nullopt;
  }

 private:
  void sample() {
    constexpr std::int64_t kPeriodNs = 200 * kUs;
    constexpr std::int64_t kMaxGapNs = 1 * kMs;  // after a longer gap between two samples, a new interval begins
    (void)realtime::enter_realtime("sampler", 30);
    for (std::int64_t next_ns = realtime::monotonic_ns(); !stop_; next_ns = realtime::monotonic_ns() + kPeriodNs) {
      realtime::sleep_until(next_ns);
      const bool is_busy = this->is_busy();
      const std::int64_t now_ns = realtime::monotonic_ns();
      const std::lock_guard lock{mutex_};
      if (is_busy && was_busy_ && now_ns - intervals_.back().end_ns <= kMaxGapNs)
        intervals_.back().end_ns = now_ns;
      else if (is_busy)
        intervals_.push_back({now_ns, now_ns});
      was_busy_ = is_busy;
    }
  }
  /// Reads the state, which follows the name in parentheses: S is a thread that waits.
  [[nodiscard]] bool is_busy() const {
    char text[256];
    const ssize_t size = ::pread(file_, text, sizeof text, 0);
    if (size <= 0) return false;  // the process has ended
    const std::string_view stat{text, static_cast<std::size_t>(size)};
    const std::size_t name_end = stat.rfind(')');
    return name_end != std::string_view::npos && name_end + 2 < stat.size() && stat[name_end + 2] != 'S';
  }

  int file_;
  mutable std::mutex mutex_;
  std::vector<Interval> intervals_;  // guarded by mutex_
  bool was_busy_ = false;            // guarded by mutex_; of the newest sample
  std::atomic<bool> stop_{false};
  std::thread sampler_;
};

}  // namespace tactus::bench
