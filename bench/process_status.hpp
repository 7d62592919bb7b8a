/// Memory of a running process, as the kernel counts it.
#pragma once

#include <sys/types.h>

#include <fstream>
#include <string>

namespace tactus::bench {

/// Returns a value of /proc/PID/status such as "VmHWM", in bytes; 0 if the process has ended.
[[nodiscard]] inline double status_bytes(pid_t pid, const std::string& name) {
  std::ifstream status{"/proc/" + std::to_string(pid) + "/status"};
  for (std::string line; std::getline(status, line);)
    if (line.rfind(name + ":", 0) == 0) return std::stod(line.substr(name.size() + 1)) * 1024;
  return 0;
}

}  // namespace tactus::bench
