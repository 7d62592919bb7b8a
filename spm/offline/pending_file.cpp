#include "spm/offline/pending_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <random>
#include <sstream>
#include <system_error>
#include <utility>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {
namespace {

[[noreturn]] void fail(const std::filesystem::path& path) {
  throw ModelError{path.string() + ": cannot be written: " + std::strerror(errno)};
}

std::string path_of(int descriptor) { return "/proc/self/fd/" + std::to_string(descriptor); }

/// Returns the path to which a link leads, also if there is no such file; otherwise `path`.
std::filesystem::path without_links(const std::filesystem::path& path) {
  constexpr int kMaxLinks = 40;  // as in Linux
  std::filesystem::path target = path;
  std::error_code error;
  for (int links = 0; std::filesystem::is_symlink(std::filesystem::symlink_status(target, error)); ++links) {
    if (links == kMaxLinks) errno = ELOOP, fail(path);
    const std::filesystem::path next = std::filesystem::read_symlink(target, error);
    if (error) errno = error.value(), fail(path);
    target = target.parent_path() / next;
  }
  return target;
}

std::string temporary_name(const std::filesystem::path& path) {
  std::ostringstream name;
  name << path.string() << '.' << std::hex << std::random_device{}();
  return name.str();
}

}  // namespace

PendingFile::PendingFile(const std::filesystem::path& path) : path_{path}, target_{without_links(path)} {
  struct stat status {};
  if (::stat(path_.c_str(), &status) == 0) {
    if (!S_ISREG(status.st_mode))
      throw ModelError{path_.string() + ": cannot be written: found no regular file, expected one or a new name"};
    mode_ = status.st_mode & (S_IRWXU | S_IRWXG | S_IRWXO);
  }
  const mode_t mode = mode_ ? S_IRUSR | S_IWUSR : S_IRUSR | S_IWUSR | S_IRGRP | S_IWGRP | S_IROTH | S_IWOTH;
  const std::filesystem::path folder = target_.has_parent_path() ? target_.parent_path() : ".";
  fd_ = ::open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, mode);
  if (fd_ >= 0 && ::access(path_of(fd_).c_str(), F_OK) == 0) return;
  if (fd_ >= 0) ::close(fd_);
  do {  // the file system has no files without a name, or there is no /proc
    temporary_ = temporary_name(target_);
    fd_ = ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
  } while (fd_ < 0 && errno == EEXIST);
  if (fd_ < 0) fail(path_);
}

PendingFile::~PendingFile() {
  if (fd_ >= 0) ::close(fd_);
  if (!temporary_.empty()) ::unlink(temporary_.c_str());
}

void PendingFile::write(const void* data, std::size_t size) {
  const char* from = static_cast<const char*>(data);
  while (size > 0) {
    const ssize_t n = ::write(fd_, from, size);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) fail(path_);
    from += n;
    size -= static_cast<std::size_t>(n);
    written_ += static_cast<std::size_t>(n);
  }
}

/// Gives the file its name, or a temporary one if there is a file with its name, because only a file with a name can
/// replace another one. Returns false and sets errno if that fails.
bool PendingFile::give_name() {
  const auto link = [this](const std::string& name) {
    return ::linkat(AT_FDCWD, path_of(fd_).c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW) == 0;
  };
  if (link(target_.string())) return true;
  if (errno != EEXIST) return false;
  const std::string name = temporary_name(target_);
  if (!link(name)) return false;
  temporary_ = name;
  return true;
}

void PendingFile::commit() {
  const bool synced = (!mode_ || ::fchmod(fd_, *mode_) == 0) && ::fsync(fd_) == 0;
  const bool named = !synced || !temporary_.empty() || give_name();
  const bool closed = ::close(std::exchange(fd_, -1)) == 0;
  if (!synced || !named || !closed) fail(path_);
  if (!temporary_.empty() && ::rename(temporary_.c_str(), target_.c_str()) != 0) fail(path_);
  temporary_.clear();
}

}  // namespace tactus::spm::offline
