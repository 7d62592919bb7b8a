/// A file that appears under its name only when it is complete.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace tactus::spm::offline {

/// Writes a temporary file next to `path`; `commit` syncs and renames it. If destroyed before, removes the temporary
/// file and leaves `path` unchanged. All functions throw ModelError that names path and cause.
class PendingFile {
 public:
  explicit PendingFile(const std::filesystem::path& path);
  PendingFile(const PendingFile&) = delete;
  PendingFile& operator=(const PendingFile&) = delete;
  ~PendingFile();

  void write(const void* data, std::size_t size);
  [[nodiscard]] std::size_t written() const noexcept { return written_; }
  void commit();

 private:
  std::filesystem::path path_;
  std::string name_;  // empty after the rename
  int fd_ = -1;
  std::size_t written_ = 0;
};

}  // namespace tactus::spm::offline
