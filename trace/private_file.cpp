#include "trace/private_file.hpp"

#include <cerrno>
#include <string>
#include <system_error>
#include <utility>

namespace tactus::trace {

PrivateFile::PrivateFile(std::filesystem::path path) : path_{std::move(path)}, file_{nullptr, &std::fclose} {
  using std::filesystem::file_type;
  std::error_code ignored;
  const file_type type = std::filesystem::symlink_status(path_, ignored).type();
  // A device or a pipe cannot be replaced, and a link would be replaced instead of its file.
  const bool can_replace = type == file_type::regular || type == file_type::not_found;
  if (type == file_type::regular && ::access(path_.c_str(), W_OK) != 0) return;
  const std::string opened = can_replace ? path_.string() + ".part" : path_.string();
  file_.reset(open_private(opened, can_replace));
  if (file_ && can_replace) unfinished_ = opened;
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
