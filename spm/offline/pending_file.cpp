#include "spm/offline/pending_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <random>
#include <sstream>
#include <utility>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {
namespace {

[[noreturn]] void fail(const std::filesystem::path& path) {
  throw ModelError{path.string() + ": cannot be written: " + std::strerror(errno)};
}

std::string path_of(int descriptor) { return "/proc/self/fd/" + std::to_string(descriptor); }

}  // namespace

PendingFile::PendingFile(const std::filesystem::path& path) : path_{path} {
  const std::filesystem::path folder = path.has_parent_path() ? path.parent_path() : ".";
  fd_ = ::open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (fd_ >= 0 && ::access(path_of(fd_).c_str(), F_OK) == 0) return;
  if (fd_ >= 0) ::close(fd_);
  temporary_ = path.string() + ".XXXXXX";  // the file system has no files without a name, or there is no /proc
  fd_ = ::mkstemp(temporary_.data());
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
  if (link(path_.string())) return true;
  if (errno != EEXIST) return false;
  std::ostringstream name;
  name << path_.string() << '.' << std::hex << std::random_device{}();
  if (!link(name.str())) return false;
  temporary_ = name.str();
  return true;
}

void PendingFile::commit() {
  const mode_t mask = ::umask(0);
  ::umask(mask);
  const bool synced = ::fchmod(fd_, 0666 & ~mask) == 0 && ::fsync(fd_) == 0;
  const bool named = !synced || !temporary_.empty() || give_name();
  const bool closed = ::close(std::exchange(fd_, -1)) == 0;
  if (!synced || !named || !closed) fail(path_);
  if (!temporary_.empty() && ::rename(temporary_.c_str(), path_.c_str()) != 0) fail(path_);
  temporary_.clear();
}

}  // namespace tactus::spm::offline
