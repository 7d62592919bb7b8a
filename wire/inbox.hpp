/// The queue from reader callbacks to a program's one thread, and the timers of that thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "wire/process.hpp"

namespace tactus::wire {

/// Many producers, one consumer. Drops and counts samples above the capacity: every topic recovers from losses.
template <class Sample>
class Inbox {
 public:
  struct Arrived {
    std::int64_t at_ns;  ///< monotonic, when it was put
    Sample sample;
  };

  explicit Inbox(std::size_t capacity) : capacity_{capacity} {}

  /// An urgent sample wakes the consumer. Another one waits until `take` times out.
  void put(Sample sample, bool urgent = true) {
    {
      const std::lock_guard lock{mutex_};
      if (samples_.size() >= capacity_) {
        ++dropped_;
        return;
      }
      samples_.push_back({monotonic_ns(), std::move(sample)});
    }
    if (urgent) arrived_.notify_one();
  }

  /// All samples in order of arrival; waits at most `patience` for the first.
  [[nodiscard]] std::vector<Arrived> take(std::chrono::microseconds patience) {
    std::unique_lock lock{mutex_};
    arrived_.wait_for(lock, patience, [this] { return !samples_.empty(); });
    return std::exchange(samples_, {});
  }

  [[nodiscard]] std::uint64_t dropped() const {
    const std::lock_guard lock{mutex_};
    return dropped_;
  }

 private:
  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  std::vector<Arrived> samples_;
  std::uint64_t dropped_ = 0;
};

/// A periodic timer: `due` is true once in every period.
class Every {
 public:
  explicit Every(std::int64_t period_ns) : period_ns_{period_ns} {}
  [[nodiscard]] bool due(std::int64_t now_ns) {
    if (now_ns < next_ns_) return false;
    next_ns_ = now_ns + period_ns_;
    return true;
  }
  /// Time until it is due; 0 when it is.
  [[nodiscard]] std::chrono::microseconds left(std::int64_t now_ns) const {
    return std::chrono::microseconds{now_ns < next_ns_ ? (next_ns_ - now_ns + 999) / 1000 : 0};
  }
  void at_once() { next_ns_ = 0; }
  /// Makes it due within `within_ns`. Repeated calls do not make it due more often than that.
  void hasten(std::int64_t now_ns, std::int64_t within_ns) { next_ns_ = std::min(next_ns_, now_ns + within_ns); }
  void set_period(std::int64_t period_ns) { period_ns_ = period_ns; }

 private:
  std::int64_t period_ns_;
  std::int64_t next_ns_ = 0;
};

/// When to publish this program's roster entry.
class Heartbeat : public Every {
 public:
  using Every::Every;
  [[nodiscard]] bool due(std::int64_t now_ns) {
    if (!Every::due(now_ns)) return false;
    if (insisting_ > 0 && --insisting_ > 0) hasten(now_ns, kInsistNs);
    return true;
  }
  /// Repeats the next entries quickly, for a participant just discovered: it may not have matched our writer yet.
  void insist() {
    insisting_ = kInsistBeats;
    at_once();
  }

 private:
  static constexpr std::int64_t kInsistNs = 20'000'000;
  static constexpr int kInsistBeats = 4;
  int insisting_ = 0;
};

/// Calls `say`, which sends a leave message, three times in 30 ms: roster samples are not acknowledged, and one burst
/// of loss must not take all. Blocks; for the end of a program.
template <class Say>
void send_leave_messages(Say&& say) {
  constexpr int kTimes = 3;
  constexpr std::chrono::milliseconds kBetween{10};
  for (int i = 0; i < kTimes; ++i) {
    say();
    std::this_thread::sleep_for(kBetween);  // after the last one too: another thread may send it
  }
}

}  // namespace tactus::wire
