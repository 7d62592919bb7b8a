/// A process that runs `tactus-latency serve`, with the control connection to it.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "latency/control_connection.hpp"
#include "netem/pair.hpp"

namespace tactus::latency {

class ServeProcess {
 public:
  using Start = std::function<pid_t(std::vector<std::string>)>;

  /// Starts `program serve` with `options`, in the caller's network namespace unless `start` chooses another one. A
  /// `program` without a path is a file in the directory of the running program. `cancelled` must outlive this. Throws
  /// LatencyError and LinkError.
  ServeProcess(const std::string& program, const std::vector<std::string>& options, const std::atomic<bool>& cancelled,
               const Start& start = netem::start_program);
  /// Ends the process. Sends SIGINT first, so that the process can remove its shared memory, and SIGKILL after 1.5 s.
  ~ServeProcess();
  ServeProcess(const ServeProcess&) = delete;
  ServeProcess& operator=(const ServeProcess&) = delete;

  [[nodiscard]] ControlConnection& control() noexcept { return control_; }

 private:
  ServeProcess(const std::string& program, const std::vector<std::string>& options, const std::atomic<bool>& cancelled,
               const Start& start, std::pair<int, int> ends);

  ControlConnection control_;
  pid_t pid_;
};

}  // namespace tactus::latency
