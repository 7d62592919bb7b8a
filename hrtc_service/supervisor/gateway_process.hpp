/// Starts the gateway of an HRTC, tactus-gateway, as a child process.
///
/// The child gets the descriptor of the shared block and no other descriptor of this process except the standard ones,
/// so it inherits no device. It is started without a copy of this process's memory (posix_spawn), because after a
/// fork() each page that the haptic thread writes would cost a page fault.
///
/// Main thread.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace tactus::hrtc_service {

/// Returns the path of tactus-gateway: in the folder of this program, or in `libexec/tactus` of an installation.
[[nodiscard]] std::filesystem::path gateway_program();

class GatewayProcess {
 public:
  /// `arguments`: of this program, without its name. `link`: descriptor of the shared block.
  GatewayProcess(const std::vector<std::string>& arguments, int link);
  /// Kills the child.
  ~GatewayProcess();
  GatewayProcess(const GatewayProcess&) = delete;
  GatewayProcess& operator=(const GatewayProcess&) = delete;

  /// Starts it, if none runs. The child begins with SIGINT, SIGUSR1 and SIGUSR2 blocked. Throws std::system_error.
  void start();
  /// Waits until the child has ended, at most `limit`. Returns its status, as waitpid() does, or nothing if it runs.
  [[nodiscard]] std::optional<int> wait(std::chrono::milliseconds limit);
  /// Sends a signal, if the child runs.
  void signal(int number) const noexcept;

 private:
  std::vector<std::string> command_;
  int link_;
  pid_t child_ = 0;      // 0: none
  int process_fd_ = -1;  // of the child
};

}  // namespace tactus::hrtc_service
