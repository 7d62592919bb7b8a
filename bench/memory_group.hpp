/// Limits the memory of some processes, and makes it short, so that the system ends one of them. Needs root.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace tactus::bench {

/// A control group (cgroup, version 1 or 2) with a limit of memory. Processes that they start belong to it, too.
class MemoryGroup {
 public:
  /// Throws std::runtime_error if the system has no such groups.
  MemoryGroup();
  /// Removes the group, if its processes have ended.
  ~MemoryGroup();
  MemoryGroup(const MemoryGroup&) = delete;
  MemoryGroup& operator=(const MemoryGroup&) = delete;

  void add(pid_t process) const;
  /// Returns a command that executes in the group the command that follows it.
  [[nodiscard]] std::vector<std::string> launcher() const;
  /// Limits the memory of the group, bytes. The system ends a process of it if even then the group needs more.
  void limit(std::size_t bytes) const;
  /// Returns the number of processes that the system has ended because of the limit.
  [[nodiscard]] std::uint64_t ended_processes() const;
  /// Limits the group to slightly more than it uses. Then another process in it takes memory until `victim` has ended.
  /// Throws std::runtime_error if the system ends that process instead.
  void exhaust(pid_t victim) const;

 private:
  void write(const std::string& file, const std::string& text) const;
  [[nodiscard]] const char* limit_file() const noexcept;
  [[nodiscard]] std::size_t used_bytes() const;

  bool is_version_1_;
  std::filesystem::path folder_;
};

}  // namespace tactus::bench
