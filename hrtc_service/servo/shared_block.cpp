#include "hrtc_service/servo/shared_block.hpp"

#include <unistd.h>

#include <array>
#include <cstring>
#include <new>
#include <stdexcept>
#include <type_traits>

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

SharedBlock::Content& SharedBlock::content() const noexcept { return *reinterpret_cast<Content*>(memory_.data()); }

SharedBlock SharedBlock::create(bool has_log) {
  const std::size_t bytes = log_offset(sizeof(Content)) + (has_log ? sizeof(ContactQuery::LogRing) : 0);
  SharedBlock block{realtime::SharedMemory::create("tactus-hrtc", bytes)};
  (new (block.memory_.data()) Content)->header = header_of_this_build(has_log);
  if (has_log) new (block.memory_.data() + log_offset(sizeof(Content))) ContactQuery::LogRing;
  return block;
}

SharedBlock SharedBlock::open(int descriptor) {
  SharedBlock block{realtime::SharedMemory::open(descriptor, sizeof(Header))};
  const Header& found = block.content().header;
  const Header expected = header_of_this_build(found.has_log);
  if (std::memcmp(found.build.data(), expected.build.data(), expected.build.size()) != 0 ||
      block.memory_.bytes() != log_offset(sizeof(Content)) + (found.has_log ? sizeof(ContactQuery::LogRing) : 0))
    throw std::runtime_error(
        "tactus-gateway is of another build than the tactus-hrtc that has started it, perhaps after an upgrade; start "
        "tactus-hrtc again");
  return block;
}

ServoLink& SharedBlock::link() const noexcept { return content().link; }

ContactQuery::LogRing* SharedBlock::log() const noexcept {
  if (memory_.bytes() == log_offset(sizeof(Content))) return nullptr;
  return reinterpret_cast<ContactQuery::LogRing*>(memory_.data() + log_offset(sizeof(Content)));
}

pid_t SharedBlock::servo() const noexcept { return content().header.servo; }

}  // namespace tactus::hrtc_service
