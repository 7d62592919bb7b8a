/// Where the callbacks of readers leave samples for a program's one thread, and how that thread keeps its appointments.
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

/// Any threads put, one takes. What does not fit is dropped and counted: every stream of samples heals by itself.
template <class Sample>
class Inbox {
 public:
  struct Arrived {
    std::int64_t at_ns;  ///< monotonic, when it was put
    Sample sample;
  };

  explicit Inbox(std::size_t capacity) : capacity_{capacity} {}

  /// What is not urgent wakes nobody: it waits until the thread has run out of patience.
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

  /// All that has come, in order, after waiting at most `patience` for a first one.
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

/// Calls `say`, which tells the roster that one leaves, three times in 30 ms: it acknowledges nothing, and one burst of
/// loss shall not take all. Blocks; for the end of a program.
template <class Say>
void send_leave_messages(Say&& say) {
  constexpr int kTimes = 3;
  constexpr std::chrono::milliseconds kBetween{10};
  for (int i = 0; i < kTimes; ++i) {
    say();
    std::this_thread::sleep_for(kBetween);  // after the last too: it may leave by another thread
  }
}

}  // namespace tactus::wire
