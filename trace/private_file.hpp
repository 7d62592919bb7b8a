/// Opens files that only their owner can read: recordings and logs contain the motion of users and names of models.
#pragma once

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <memory>

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

/// A file that only its owner can read, and that replaces another one only when it gets its name.
///
/// Until `commit`, it has the name `path` with the suffix ".part", and `path` is unchanged. Without `commit`, the
/// destructor removes it. But if `path` is a device, a pipe or a link, this object writes to it directly. Functions
/// that fail set errno.
class PrivateFile {
 public:
  /// `get` returns null if this failed.
  explicit PrivateFile(std::filesystem::path path);
  ~PrivateFile();
  PrivateFile(const PrivateFile&) = delete;
  PrivateFile& operator=(const PrivateFile&) = delete;

  /// Returns whether a PrivateFile of this path can be written now. If not, sets errno. Changes no file.
  [[nodiscard]] static bool can_write(const std::filesystem::path& path);

  [[nodiscard]] std::FILE* get() const noexcept { return file_.get(); }
  /// Writes the buffer of the file, and gives it its name. The file remains open. Returns false if that failed, or if
  /// an earlier write has failed.
  [[nodiscard]] bool commit();

 private:
  [[nodiscard]] static bool can_replace(const std::filesystem::path& path);

  std::filesystem::path path_;
  std::filesystem::path unfinished_;  // name of the file until `commit`; empty: it has no such name
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
};

}  // namespace tactus::trace
