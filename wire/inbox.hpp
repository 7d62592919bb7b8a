/// The queue from reader callbacks to a program's one thread.
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
  [[nodiscard]] std::vector<Arrived> take(std::chrono::microseconds timeout) {
    std::unique_lock lock{mutex_};
    arrived_.wait_for(lock, timeout, [this] { return !samples_.empty(); });
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
