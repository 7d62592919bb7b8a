/// The queue from reader callbacks to the one thread of a program that processes samples.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "realtime/process.hpp"

namespace tactus::wire {

enum class Urgency : std::uint8_t {
  kWaits,      ///< the sample does not wake the consumer: it waits until another one does, or until `take` times out
  kWakes,      ///< the sample wakes the consumer
  kMustArrive  ///< as kWakes; also uses a reserve when the inbox is full, because the sample is sent once
};

/// Many producers, one consumer. Drops and counts samples above the capacity. All topics recover from such losses
/// except those whose samples are sent once (kIsSentOnce in topics.hpp), which are put with kMustArrive.
template <class Sample>
class Inbox {
 public:
  struct Arrived {
    std::int64_t at_ns;  ///< time of `put`, monotonic clock
    Sample sample;
  };

  explicit Inbox(std::size_t capacity) : capacity_{capacity} {}

  void put(Sample sample, Urgency urgency = Urgency::kWakes) {
    {
      const std::lock_guard lock{mutex_};
      if (samples_.size() >= capacity_ + (urgency == Urgency::kMustArrive ? kReserve : 0)) {
        ++dropped_;
        return;
      }
      samples_.push_back({realtime::monotonic_ns(), std::move(sample)});
    }
    if (urgency != Urgency::kWaits) arrived_.notify_one();
  }

  /// Returns all samples in the order of their arrival. Waits at most `timeout` for the first.
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
  static constexpr std::size_t kReserve = 1024;
  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  std::vector<Arrived> samples_;
  std::uint64_t dropped_ = 0;
};

/// Calls `send`, which sends a leave message, three times in 30 ms. Call it at the end of a program. Roster samples are
/// not acknowledged, so the messages are spread in time: one burst of loss must not drop all three. Blocks.
template <class Send>
void send_leave_messages(Send&& send) {
  constexpr int kTimes = 3;
  constexpr std::chrono::milliseconds kBetween{10};
  for (int i = 0; i < kTimes; ++i) {
    send();
    std::this_thread::sleep_for(kBetween);  // also after the last message, which another thread may have to send
  }
}

}  // namespace tactus::wire
