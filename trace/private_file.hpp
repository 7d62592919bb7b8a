/// Opens files that only their owner can read: recordings and logs contain the motion of users and names of models.
#pragma once

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>

namespace tactus::trace {

/// Opens an empty file for writing. A regular file gets the permissions 0600, also if it existed. Returns null and sets
/// errno if that fails. `is_new`: replaces a file or link of that name and follows no link.
[[nodiscard]] inline std::FILE* open_private(const std::filesystem::path& path, bool is_new = false) {
  if (is_new) (void)::unlink(path.c_str());
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | (is_new ? O_EXCL | O_NOFOLLOW : O_TRUNC),
                        S_IRUSR | S_IWUSR);
  struct stat status {};
  if (fd < 0) return nullptr;
  if (::fstat(fd, &status) == 0 && S_ISREG(status.st_mode)) (void)::fchmod(fd, S_IRUSR | S_IWUSR);
  return ::fdopen(fd, "wb");
}

}  // namespace tactus::trace
