#include "hrtc_service/servo/shared_block.hpp"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <new>
#include <stdexcept>
#include <system_error>
#include <type_traits>
#include <utility>

#include "hrtc_service/servo/build_id.hpp"

namespace tactus::hrtc_service {
namespace {

/// Two builds may give the block another layout, so each block has the identity of its build.
struct Header {
  std::array<char, 128> build{};  // build_id(), with zero bytes behind it
  pid_t servo = 0;
  bool has_log = false;
};

Header header_of_this_build(bool has_log) {
  Header header;
  std::strncpy(header.build.data(), build_id(), header.build.size() - 1);
  header.servo = getpid();
  header.has_log = has_log;
  return header;
}

[[noreturn]] void fail(const char* what) { throw std::system_error{errno, std::generic_category(), what}; }

constexpr int kFixedSize = F_SEAL_SHRINK | F_SEAL_GROW;

}  // namespace

struct SharedBlock::Content {
  Header header;
  ServoLink link;
};
static_assert(std::is_trivially_destructible_v<ServoLink> && std::is_trivially_destructible_v<ContactQuery::LogRing>);
static_assert(std::atomic<std::uint64_t>::is_always_lock_free, "used by two processes");

namespace {

/// Offset of the ring of logged queries.
constexpr std::size_t log_offset(std::size_t content_bytes) {
  constexpr std::size_t kAlignment = alignof(ContactQuery::LogRing);
  return (content_bytes + kAlignment - 1) / kAlignment * kAlignment;
}

}  // namespace

SharedBlock::SharedBlock(int descriptor, std::size_t bytes) : descriptor_{descriptor}, bytes_{bytes} {
  memory_ = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
  if (memory_ == MAP_FAILED) {
    const int error = errno;
    ::close(descriptor);
    errno = error;
    fail("mmap of the shared block");
  }
}

SharedBlock::~SharedBlock() {
  if (memory_ == nullptr) return;
  munmap(memory_, bytes_);
  ::close(descriptor_);
}

SharedBlock::SharedBlock(SharedBlock&& other) noexcept
    : descriptor_{std::exchange(other.descriptor_, -1)},
      bytes_{other.bytes_},
      memory_{std::exchange(other.memory_, nullptr)} {}

SharedBlock SharedBlock::create(bool has_log) {
  const int descriptor = memfd_create("tactus-hrtc", MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (descriptor < 0) fail("memfd_create");
  const std::size_t bytes = log_offset(sizeof(Content)) + (has_log ? sizeof(ContactQuery::LogRing) : 0);
  if (ftruncate(descriptor, static_cast<off_t>(bytes)) != 0 ||
      fcntl(descriptor, F_ADD_SEALS, kFixedSize | F_SEAL_SEAL) != 0) {
    const int error = errno;
    ::close(descriptor);
    errno = error;
    fail("size of the shared block");
  }
  SharedBlock block{descriptor, bytes};
  (new (block.memory_) Content)->header = header_of_this_build(has_log);
  if (has_log) new (static_cast<std::byte*>(block.memory_) + log_offset(sizeof(Content))) ContactQuery::LogRing;
  return block;
}

SharedBlock SharedBlock::open(int descriptor) {
  struct stat status {};
  const int fixed = fcntl(descriptor, F_GET_SEALS);
  if (fixed < 0 || (fixed & kFixedSize) != kFixedSize || fstat(descriptor, &status) != 0 ||
      static_cast<std::size_t>(status.st_size) < sizeof(Header))
    throw std::runtime_error("descriptor " + std::to_string(descriptor) +
                             " is not the memory of a servo; tactus-hrtc starts this program");
  if (fcntl(descriptor, F_SETFD, FD_CLOEXEC) != 0) fail("fcntl(F_SETFD)");
  SharedBlock block{descriptor, static_cast<std::size_t>(status.st_size)};
  const Header& found = static_cast<const Content*>(block.memory_)->header;
  const Header expected = header_of_this_build(found.has_log);
  if (std::memcmp(found.build.data(), expected.build.data(), expected.build.size()) != 0 ||
      block.bytes_ != log_offset(sizeof(Content)) + (found.has_log ? sizeof(ContactQuery::LogRing) : 0))
    throw std::runtime_error(
        "tactus-gateway is of another build than the tactus-hrtc that has started it, perhaps after an upgrade; start "
        "tactus-hrtc again");
  return block;
}

ServoLink& SharedBlock::link() const noexcept { return static_cast<Content*>(memory_)->link; }

ContactQuery::LogRing* SharedBlock::log() const noexcept {
  if (bytes_ == log_offset(sizeof(Content))) return nullptr;
  return reinterpret_cast<ContactQuery::LogRing*>(static_cast<std::byte*>(memory_) + log_offset(sizeof(Content)));
}

pid_t SharedBlock::servo() const noexcept { return static_cast<const Content*>(memory_)->header.servo; }

}  // namespace tactus::hrtc_service
