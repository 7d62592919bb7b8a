/// Runs a program as a child process that shares memory with this one.
///
///     parent: ChildProcess{{helper_program("tactus-device"), ...}, memory.descriptor()}.start()
///     child:  follow_parent(parent); SharedMemory::open(ChildProcess::kSharedMemory, ...)
#pragma once

#include <sys/types.h>

#include <chrono>
#include <optional>
#include <string>
#include <vector>

namespace tactus::realtime {

/// Returns the path of a program that users do not start: in `libexec/tactus` of the installation, in `bin` of a build
/// tree, or in the folder of this program.
[[nodiscard]] std::string helper_program(const std::string& name);

/// Returns how a process ended, for example "was killed by SIGSEGV", "has failed" or "has ended". `wait_status`: as of waitpid().
[[nodiscard]] std::string text_of_end(int wait_status);

/// In a child: ends this process with its parent. When the parent ends, the child gets SIGTERM. If it still runs 5 to 6 s
/// later, it ends itself by _exit(). Ignores SIGINT, SIGUSR1 and SIGUSR2. Throws std::runtime_error if the parent has
/// ended.
void follow_parent(pid_t parent);

/// Forbids this process to read or change other processes as a debugger does, except those that it starts; from Linux 6.12
/// on, also to send them signals. Call it before there is a second thread. Needs no rights. Returns false if the kernel
/// has no Landlock.
bool forbid_debugging_others() noexcept;

/// The child gets the descriptor of the shared memory and no other descriptor of this process except the standard ones,
/// so it inherits no device. It is started without a copy of this process's memory (posix_spawn), because after a
/// fork() each page that the haptic thread writes would cost a page fault.
///
/// One thread at a time. The child gets SIGTERM when the thread that has started it ends.
class ChildProcess {
 public:
  static constexpr int kSharedMemory = 3;  ///< descriptor of the shared memory in the child

  /// `command`: path of the program, and its arguments. `memory`: descriptor of the shared memory.
  ChildProcess(std::vector<std::string> command, int memory);
  /// Kills the child.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// Starts it; none may run. The child begins with SIGINT, SIGUSR1 and SIGUSR2 blocked, until `follow_parent`. Throws
  /// std::system_error.
  void start();
  /// Waits until the child has ended, at most `limit`. Returns its status, as waitpid() does, or nothing if it runs.
  [[nodiscard]] std::optional<int> wait(std::chrono::milliseconds limit);
  /// Sends a signal, if the child runs.
  void signal(int number) const noexcept;

 private:
  std::vector<std::string> command_;
  int memory_;
  pid_t child_ = 0;      // 0: none
  int process_fd_ = -1;  // of the child
};

}  // namespace tactus::realtime
