/// Starts a program as a user would start it, and returns its output, its exit status, and whether processes remain.
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

/// Time after which a test that waits for an event fails. The time is long because the machine may be busy.
inline constexpr std::chrono::milliseconds kWatchdog = 20s;

/// A running program in a process group of its own, with both output streams in one pipe. The kernel kills the program
/// when the thread that started it ends. The destructor kills the whole process group of the program. Until then, no
/// other process gets the id of the program, and the program remains a zombie after its end. Call the members from one
/// thread at a time.
class Process {
 public:
  /// `command[0]` is a path. If the command cannot be run, the exit status is 127.
  explicit Process(std::vector<std::string> command);
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  /// Output so far.
  [[nodiscard]] std::string output() const;
  /// Waits for a line of output with a match of `pattern` (ECMAScript, anywhere in the line). False if the program ends
  /// or `limit` passes first.
  [[nodiscard]] bool wait_for_line(const std::string& pattern, std::chrono::milliseconds limit = kWatchdog) const;
  /// Sends a signal to the program, not to its group. Does nothing once the program has ended.
  void signal(int number);
  /// Sends a signal to the program and to all that it has started. Does nothing once the program has ended.
  void signal_all(int number);
  /// Waits until the program has ended and no process holds its output pipe. Returns the exit status, or 128 plus the
  /// signal that killed the program. Returns nothing after `limit`. Once a status is returned, the output is complete.
  [[nodiscard]] std::optional<int> wait(std::chrono::milliseconds limit = kWatchdog);
  /// False once the program has ended and its output is complete.
  [[nodiscard]] bool running() const;
  [[nodiscard]] pid_t pid() const noexcept { return pid_; }
  /// Returns the id of the program, and then those of the processes that its main thread has started and that run.
  [[nodiscard]] std::vector<pid_t> pids() const;
  /// Returns the id of the first process of this name that its main thread has started and that runs, or 0.
  [[nodiscard]] pid_t child(const std::string& name) const;
  /// True if no process of the program's group runs. Call it after the program has ended.
  [[nodiscard]] bool left_nothing_running() const;

 private:
  void read_until_end(int pipe);

  pid_t pid_ = 0;
  mutable std::mutex mutex_;
  mutable std::condition_variable changed_;  // output or status
  std::string output_;
  std::optional<int> status_;
  std::thread reader_;
};

}  // namespace tactus::e2e
