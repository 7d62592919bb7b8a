/// Blocks receive threads until their participant has been created.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <mutex>

namespace tactus::wire {

/// Closed until `open` is called, and open from then on. Threads: any.
class Gate {
 public:
  explicit Gate(std::chrono::milliseconds timeout = std::chrono::seconds{1}) : timeout_{timeout} {}
  void open() noexcept;
  /// Waits until the gate is open, at most for the timeout. Without a timeout, a participant that fails to start would
  /// wait forever for its receive threads.
  void pass();

 private:
  std::chrono::milliseconds timeout_;
  std::mutex mutex_;
  std::condition_variable opened_;
  std::atomic<bool> open_{false};
};

}  // namespace tactus::wire
