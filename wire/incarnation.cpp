#include "wire/incarnation.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdlib>
#include <string>
#include <system_error>

namespace tactus::wire {

std::filesystem::path state_folder() {
  if (const char* const state = std::getenv("XDG_STATE_HOME"); state != nullptr && *state == '/')
    return std::filesystem::path{state} / "tactus";
  if (const char* const home = std::getenv("HOME"); home != nullptr && *home == '/')
    return std::filesystem::path{home} / ".local/state/tactus";
  return {};
}

std::filesystem::path incarnation_file() {
  const std::filesystem::path folder = state_folder();
  return folder.empty() ? folder : folder / "incarnation";
}

std::uint64_t next_incarnation(const std::filesystem::path& file, std::uint64_t clock_ns) noexcept try {
  if (file.empty()) return clock_ns;
  std::error_code ignored;
  std::filesystem::create_directories(file.parent_path(), ignored);
  const int fd = open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd < 0) return clock_ns;
  std::uint64_t next = clock_ns;
  if (flock(fd, LOCK_EX) == 0) {
    std::array<char, 32> text{};
    const ssize_t size = std::max<ssize_t>(0, pread(fd, text.data(), text.size(), 0));
    std::uint64_t last = 0;
    if (std::from_chars(text.data(), text.data() + size, last).ec == std::errc{} && last != UINT64_MAX)
      next = std::max(clock_ns, last + 1);
    const std::string line = std::to_string(next) + "\n";
    if (pwrite(fd, line.data(), line.size(), 0) == static_cast<ssize_t>(line.size()))
      (void)!ftruncate(fd, static_cast<off_t>(line.size()));
  }
  close(fd);
  return next;
} catch (...) {  // out of memory
  return clock_ns;
}

}  // namespace tactus::wire
