/// A file that is there under its name only once it is complete.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

namespace tactus::spm::offline {

/// Writes beside its path under a name of its own; `commit` syncs and renames. Destroyed before that, it leaves
/// nothing, and what was there under the name stays. All of it throws ModelError naming path and cause.
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
  std::string name_;  // empty once it has the name of path_
  int fd_ = -1;
  std::size_t written_ = 0;
};

}  // namespace tactus::spm::offline
