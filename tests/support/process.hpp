/// A program started as a user would start it: what it prints, how it ends, and that nothing of it stays behind.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace tactus::e2e {

using namespace std::chrono_literals;

/// How long a test waits before it gives up on something that has to happen; the machine may be busy.
inline constexpr std::chrono::milliseconds kWatchdog = 20s;

/// Intervals in a process group of its own, with both output streams in one pipe. Dies with the thread that started it,
/// and at the latest when this is destroyed, its group with it. Functions may be called from one thread.
class Process {
 public:
  /// `command[0]` is a path. A command that cannot be run ends with 127.
  explicit Process(std::vector<std::string> command);
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  /// What it has printed so far.
  [[nodiscard]] std::string output() const;
  /// Waits until a line matches (ECMAScript, anywhere in it). False when it ends or `limit` passes without one.
  [[nodiscard]] bool wait_for_line(const std::string& pattern, std::chrono::milliseconds limit = kWatchdog) const;
  /// To the process alone. Nothing once it has ended.
  void signal(int number);
  /// Exit status, or 128 and the signal that killed it; none when it runs on for `limit`. Its output is complete then.
  [[nodiscard]] std::optional<int> wait(std::chrono::milliseconds limit = kWatchdog);
  [[nodiscard]] bool running() const;
  [[nodiscard]] pid_t pid() const noexcept { return pid_; }
  /// Nothing of its process group is alive. Asked after it has ended.
  [[nodiscard]] bool left_nothing_running() const;

 private:
  void watch(int pipe);

  pid_t pid_ = 0;
  mutable std::mutex mutex_;
  mutable std::condition_variable news_;
  std::string output_;
  std::optional<int> status_;
  std::thread watcher_;
};

}  // namespace tactus::e2e
