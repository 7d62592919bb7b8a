/// Writes a file that gets its name only when it is complete.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace tactus::spm::offline {

/// Writes a temporary file in the folder of `path`; `commit` syncs it and renames it to `path`. Without `commit`, the
/// destructor removes the temporary file, and `path` is unchanged. All functions throw ModelError that names path and
/// cause.
class PendingFile {
 public:
  explicit PendingFile(const std::filesystem::path& path);
  PendingFile(const PendingFile&) = delete;
  PendingFile& operator=(const PendingFile&) = delete;
  ~PendingFile();

  void write(const void* data, std::size_t size);
  /// Number of bytes written.
  [[nodiscard]] std::size_t written() const noexcept { return written_; }
  void commit();

 private:
  std::filesystem::path path_;
  std::string temporary_;  // name of the temporary file; empty after the rename
  int fd_ = -1;
  std::size_t written_ = 0;
};

}  // namespace tactus::spm::offline
