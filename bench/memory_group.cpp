#include "bench/memory_group.hpp"

#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <system_error>

namespace tactus::bench {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kStep = 1 << 20, kMargin = 32 * kStep;  // bytes

/// In a child after a fork, so it allocates nothing by `new`. Returns whether `victim` has ended. If its end does not free
/// enough, the system ends this child next, which has the second largest score: 900 thousandths of the limit.
bool take_memory(int group, int score, int victim) {
  if (::write(score, "900", 3) != 3 || ::write(group, "0", 1) != 1) return false;  // 0: this process
  pollfd end{victim, POLLIN, 0};
  for (std::size_t taken = 0; taken < 16 * kMargin; taken += kStep) {
    void* const memory = mmap(nullptr, kStep, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) return false;
    std::memset(memory, 1, kStep);
    // The memory of the victim is free some milliseconds before it has ended, and would be taken too.
    const int pause_ms = taken + 8 * kStep > kMargin ? 20 : 0;
    if (poll(&end, 1, pause_ms) == 1) return true;
  }
  return poll(&end, 1, 1000) == 1;
}

}  // namespace

MemoryGroup::MemoryGroup() : is_version_1_{fs::exists("/sys/fs/cgroup/memory/memory.limit_in_bytes")} {
  const fs::path root = is_version_1_ ? "/sys/fs/cgroup/memory" : "/sys/fs/cgroup";
  folder_ = root / ("tactus-bench-" + std::to_string(getpid()));
  std::error_code error;
  fs::create_directory(folder_, error);
  if (!fs::exists(folder_ / (is_version_1_ ? "memory.limit_in_bytes" : "memory.max")))
    throw std::runtime_error("found no control group with a limit of memory at " + folder_.string() +
                             ", expected root and cgroups that limit memory");
}

MemoryGroup::~MemoryGroup() { ::rmdir(folder_.c_str()); }

void MemoryGroup::add(pid_t process) const { write("cgroup.procs", std::to_string(process)); }

std::vector<std::string> MemoryGroup::launcher() const {
  return {"/bin/sh", "-c", "echo $$ > '" + (folder_ / "cgroup.procs").string() + "' && exec \"$@\"", "sh"};
}

void MemoryGroup::limit(std::size_t bytes) const { write(limit_file(), std::to_string(bytes)); }

std::uint64_t MemoryGroup::ended_processes() const {
  std::ifstream events{folder_ / (is_version_1_ ? "memory.oom_control" : "memory.events")};
  std::uint64_t count = 0;
  for (std::string name; events >> name >> count;)
    if (name == "oom_kill") return count;
  throw std::runtime_error("found no number of ended processes of " + folder_.string());
}

void MemoryGroup::exhaust(pid_t victim) const {
  limit(used_bytes() + kMargin);
  const int group = ::open((folder_ / "cgroup.procs").c_str(), O_WRONLY | O_CLOEXEC);
  const int victim_fd = static_cast<int>(syscall(SYS_pidfd_open, victim, 0));
  const pid_t child = fork();
  if (child == 0) {
    const int score = ::open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC);
    _exit(take_memory(group, score, victim_fd) ? 0 : 1);
  }
  int status = -1;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  pollfd end{victim_fd, POLLIN, 0};
  const bool has_ended = poll(&end, 1, 1000) == 1;
  ::close(group);
  ::close(victim_fd);
  write(limit_file(), is_version_1_ ? "-1" : "max");
  if (!has_ended) throw std::runtime_error("a lack of memory did not end process " + std::to_string(victim));
}

const char* MemoryGroup::limit_file() const noexcept { return is_version_1_ ? "memory.limit_in_bytes" : "memory.max"; }

void MemoryGroup::write(const std::string& file, const std::string& text) const {
  std::ofstream stream{folder_ / file};
  stream << text << std::flush;
  if (!stream) throw std::system_error{errno, std::generic_category(), (folder_ / file).string() + ": " + text};
}

std::size_t MemoryGroup::used_bytes() const {
  std::size_t bytes = 0;
  std::ifstream{folder_ / (is_version_1_ ? "memory.usage_in_bytes" : "memory.current")} >> bytes;
  return bytes;
}

}  // namespace tactus::bench
