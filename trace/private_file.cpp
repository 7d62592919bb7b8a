#include "trace/private_file.hpp"

#include <cerrno>
#include <string>
#include <system_error>
#include <utility>

namespace tactus::trace {

/// A device or a pipe cannot be replaced, and a link would be replaced instead of its file.
bool PrivateFile::can_replace(const std::filesystem::path& path) {
  using std::filesystem::file_type;
  std::error_code ignored;
  const file_type type = std::filesystem::symlink_status(path, ignored).type();
  return type == file_type::regular || type == file_type::not_found;
}

bool PrivateFile::can_write(const std::filesystem::path& path) {
  if (can_replace(path)) return PrivateFile{path}.get() != nullptr;
  if (::access(path.c_str(), W_OK) == 0) return true;
  if (errno != ENOENT) return false;
  // The file of a link that does not exist yet.
  std::error_code ignored;
  const std::filesystem::path target = path.parent_path() / std::filesystem::read_symlink(path, ignored);
  return ::access(target.parent_path().empty() ? "." : target.parent_path().c_str(), W_OK) == 0;
}

PrivateFile::PrivateFile(std::filesystem::path path) : path_{std::move(path)}, file_{nullptr, &std::fclose} {
  const bool replaces = can_replace(path_);
  std::error_code ignored;
  if (replaces && std::filesystem::exists(path_, ignored) && ::access(path_.c_str(), W_OK) != 0) return;
  const std::string opened = replaces ? path_.string() + ".part" : path_.string();
  file_.reset(open_private(opened, replaces));
  if (file_ && replaces) unfinished_ = opened;
}

PrivateFile::~PrivateFile() {
  if (!unfinished_.empty()) (void)::unlink(unfinished_.c_str());
}

bool PrivateFile::commit() {
  if (std::ferror(file_.get()) != 0 || std::fflush(file_.get()) != 0) return false;
  if (!unfinished_.empty() && std::rename(unfinished_.c_str(), path_.c_str()) != 0) return false;
  unfinished_.clear();
  return true;
}

}  // namespace tactus::trace
