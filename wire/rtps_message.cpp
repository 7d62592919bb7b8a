#include "wire/rtps_message.hpp"

#include <algorithm>
#include <array>

namespace tactus::wire {

std::optional<Submessage> submessage_at(const std::uint8_t* message, std::uint32_t size, std::uint32_t at) noexcept {
  if (at > size || size - at < kSubmessageHead) return std::nullopt;
  const std::uint8_t* const head = message + at;
  Submessage found{head + kSubmessageHead, size - at - kSubmessageHead, head[0], head[1], false, size};
  const std::uint32_t length = found.little_endian() ? head[2] | head[3] << 8u : head[3] | head[2] << 8u;
  found.last = length == 0 && found.id != kPadId && found.id != kInfoTimeId;
  if (found.last) return found;
  found.size = std::min(found.size, length);
  constexpr std::uint32_t kAlignment = 4;
  found.next = at + kSubmessageHead + (length + kAlignment - 1) / kAlignment * kAlignment;
  return found;
}

std::uint32_t pad_what_looks_like_statistics(std::uint8_t* message, std::uint32_t size) noexcept {
  constexpr std::array<std::uint8_t, kSubmessageHead> kPadding{kPadId, 1, 0, 0};  // the shortest submessage
  while (size >= kStatisticsSize && message[size - kStatisticsSize] == kStatisticsId) {
    std::copy(kPadding.begin(), kPadding.end(), message + size);
    size += kSubmessageHead;
  }
  return size;
}

std::uint32_t size_without_statistics(const std::uint8_t* message, std::uint32_t size) noexcept {
  std::uint32_t at = kRtpsHeader;
  while (const std::optional<Submessage> found = submessage_at(message, size, at)) {
    if (found->id == kStatisticsId) return at;
    if (found->last) break;
    at = found->next;
  }
  return size;
}

}  // namespace tactus::wire
