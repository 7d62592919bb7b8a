/// Cuts a message into the pieces of chunks: a first part that fills the room left in a chunk, then equal parts.
///
///     | first_bytes | part_bytes | part_bytes | ... | remainder |      `count` parts, `bytes` in all
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

#include "session/messages.hpp"

namespace tactus::session {

struct MessageParts {
  std::uint32_t bytes = 0;
  std::uint16_t first_bytes = 0, part_bytes = 0;
  std::uint32_t count = 1;

  /// Cuts `bytes` of a region, or of a base mesh, so that the first part fits into `room` bytes of a chunk.
  [[nodiscard]] static MessageParts cut(std::uint32_t bytes, std::uint32_t region, std::size_t room) noexcept {
    const auto max_parts = static_cast<std::uint32_t>(bytes / (kMaxPayload / 2) + 2);
    const std::size_t head = header_bytes(region, max_parts);
    MessageParts parts;
    parts.bytes = bytes;
    parts.part_bytes = static_cast<std::uint16_t>(kMaxPayload - head);
    parts.first_bytes = static_cast<std::uint16_t>(std::min<std::size_t>(bytes, room - head));
    const std::uint32_t rest = bytes - parts.first_bytes;
    parts.count = 1 + rest / parts.part_bytes + (rest % parts.part_bytes != 0 ? 1 : 0);
    return parts;
  }
  /// First byte of a part in the message, and the byte after its last.
  [[nodiscard]] std::pair<std::size_t, std::size_t> range(std::uint32_t part) const noexcept {
    if (part == 0) return {0, first_bytes};
    const std::size_t from = first_bytes + std::size_t{part_bytes} * (part - 1u);
    return {from, std::min<std::size_t>(from + part_bytes, bytes)};
  }
};

}  // namespace tactus::session
