/// Holds receive threads back until their participant exists.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>

namespace tactus::wire {

/// Closed until opened, then open for good. Threads: any.
class Gate {
 public:
  explicit Gate(std::chrono::milliseconds patience = std::chrono::seconds{1}) : patience_{patience} {}
  void open() noexcept;
  /// Returns when it is open, or after `patience`: a participant that fails to be made waits for its receive threads.
  void pass();

 private:
  std::chrono::milliseconds patience_;
  std::mutex mutex_;
  std::condition_variable opened_;
  std::atomic<bool> open_{false};
};

}  // namespace tactus::wire
