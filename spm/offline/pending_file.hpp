/// Writes a file that gets its name only when it is complete.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>

namespace tactus::spm::offline {

/// Writes a file without a name in the folder of `path`. `commit` syncs it and gives it the name `path`, and replaces a
/// regular file of that name, whose permissions remain. If `path` is a link, this holds for the file to which it leads.
/// Without `commit`, also if the process is killed, `path` is unchanged and nothing remains. But if the file system has
/// only files with names, a killed process leaves a file with a temporary one. All functions throw ModelError that
/// names path and cause. The constructor also throws if `path` is a device, a pipe or a folder.
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
  [[nodiscard]] bool give_name();

  std::filesystem::path path_;
  std::filesystem::path target_;  // `path_`, or the file to which it leads
  std::optional<unsigned> mode_;  // permissions of the replaced file, if there is one
  std::string temporary_;         // temporary name; empty if the file has none, and after the rename
  int fd_ = -1;
  std::size_t written_ = 0;
};

}  // namespace tactus::spm::offline
