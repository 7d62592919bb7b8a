/// Where DDS callbacks leave samples for the service thread.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <utility>
#include <vector>

namespace tactus::hrtc_service {

/// Any threads put, one takes. Bounded: what does not fit is dropped and counted, for every stream heals by itself.
template <class Sample>
class Inbox {
 public:
  explicit Inbox(std::size_t capacity) : capacity_{capacity} {}

  void put(Sample sample) {
    {
      const std::lock_guard lock{mutex_};
      if (samples_.size() >= capacity_) {
        ++dropped_;
        return;
      }
      samples_.push_back(std::move(sample));
    }
    arrived_.notify_one();
  }

  /// All samples so far, after waiting at most `patience` for a first one.
  [[nodiscard]] std::vector<Sample> take(std::chrono::microseconds patience) {
    std::vector<Sample> taken;
    std::unique_lock lock{mutex_};
    arrived_.wait_for(lock, patience, [this] { return !samples_.empty(); });
    taken.swap(samples_);
    return taken;
  }

  [[nodiscard]] std::uint64_t dropped() const {
    const std::lock_guard lock{mutex_};
    return dropped_;
  }

 private:
  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::condition_variable arrived_;
  std::vector<Sample> samples_;
  std::uint64_t dropped_ = 0;
};

}  // namespace tactus::hrtc_service
