/// Blocks receive threads until their participant has been created.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>

namespace tactus::wire {

/// Closed until `open`, then open for good. Threads: any.
class Gate {
 public:
  explicit Gate(std::chrono::milliseconds timeout = std::chrono::seconds{1}) : timeout_{timeout} {}
  void open() noexcept;
  /// Returns when open, or after the timeout, because a participant that fails to start waits for its receive threads.
  void pass();

 private:
  std::chrono::milliseconds timeout_;
  std::mutex mutex_;
  std::condition_variable opened_;
  std::atomic<bool> open_{false};
};

}  // namespace tactus::wire
