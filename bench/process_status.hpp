/// Memory and CPU time of a running process, as the kernel counts them.
#pragma once

#include <sys/types.h>
#include <time.h>

#include <fstream>
#include <string>

#include "tests/support/process.hpp"

namespace tactus::bench {

/// Returns a value of /proc/PID/status such as "VmHWM", in bytes; 0 if the process has ended.
[[nodiscard]] inline double status_bytes(pid_t pid, const std::string& name) {
  std::ifstream status{"/proc/" + std::to_string(pid) + "/status"};
  for (std::string line; std::getline(status, line);)
    if (line.rfind(name + ":", 0) == 0) return std::stod(line.substr(name.size() + 1)) * 1024;
  return 0;
}

/// Returns the CPU time of a running process, s; 0 if the process has ended.
[[nodiscard]] inline double cpu_seconds(pid_t pid) {
  clockid_t clock = 0;
  timespec time{};
  if (clock_getcpuclockid(pid, &clock) != 0 || clock_gettime(clock, &time) != 0) return 0;
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Returns the CPU time of a running program and of the processes that it has started and that run, s.
[[nodiscard]] inline double cpu_seconds(const e2e::Process& program) {
  double sum = 0;
  for (const pid_t pid : program.pids()) sum += cpu_seconds(pid);
  return sum;
}

}  // namespace tactus::bench
