#include "realtime/shared_memory.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

namespace tactus::realtime {
namespace {

/// Throws the current error of the system, after it has closed the descriptor.
[[noreturn]] void fail(const char* what, int descriptor) {
  const int error = errno;
  if (descriptor >= 0) ::close(descriptor);
  throw std::system_error{error, std::generic_category(), what};
}

constexpr int kFixedSize = F_SEAL_SHRINK | F_SEAL_GROW;

}  // namespace

SharedMemory::SharedMemory(int descriptor, std::size_t bytes) : descriptor_{descriptor}, bytes_{bytes} {
  data_ = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
  if (data_ == MAP_FAILED) fail("mmap of shared memory", descriptor);
}

SharedMemory::~SharedMemory() {
  if (data_ == nullptr) return;
  munmap(data_, bytes_);
  ::close(descriptor_);
}

SharedMemory::SharedMemory(SharedMemory&& other) noexcept
    : descriptor_{std::exchange(other.descriptor_, -1)},
      bytes_{other.bytes_},
      data_{std::exchange(other.data_, nullptr)} {}

SharedMemory SharedMemory::create(const char* name, std::size_t bytes) {
  const int descriptor = memfd_create(name, MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (descriptor < 0) fail("memfd_create", descriptor);
  if (ftruncate(descriptor, static_cast<off_t>(bytes)) != 0 ||
      fcntl(descriptor, F_ADD_SEALS, kFixedSize | F_SEAL_SEAL) != 0)
    fail("size of shared memory", descriptor);
  return {descriptor, bytes};
}

SharedMemory SharedMemory::open(int descriptor, std::size_t min_bytes) {
  struct stat status {};
  const int fixed = fcntl(descriptor, F_GET_SEALS);
  if (fixed < 0 || (fixed & kFixedSize) != kFixedSize || fstat(descriptor, &status) != 0 ||
      static_cast<std::size_t>(status.st_size) < min_bytes)
    throw std::runtime_error("descriptor " + std::to_string(descriptor) +
                             " is not the shared memory of a parent process, of at least " + std::to_string(min_bytes) +
                             " bytes");
  if (fcntl(descriptor, F_SETFD, FD_CLOEXEC) != 0) fail("fcntl(F_SETFD)", descriptor);
  return {descriptor, static_cast<std::size_t>(status.st_size)};
}

}  // namespace tactus::realtime
