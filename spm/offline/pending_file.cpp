#include "spm/offline/pending_file.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {
namespace {

[[noreturn]] void fail(const std::filesystem::path& path) {
  throw ModelError{path.string() + ": cannot be written: " + std::strerror(errno)};
}

}  // namespace

PendingFile::PendingFile(const std::filesystem::path& path) : path_{path}, temporary_{path.string() + ".XXXXXX"} {
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

void PendingFile::commit() {
  const mode_t mask = ::umask(0);
  ::umask(mask);
  const bool synced = ::fchmod(fd_, 0666 & ~mask) == 0 && ::fsync(fd_) == 0;
  const bool closed = ::close(std::exchange(fd_, -1)) == 0;
  if (!synced || !closed || ::rename(temporary_.c_str(), path_.c_str()) != 0) fail(path_);
  temporary_.clear();
}

}  // namespace tactus::spm::offline
