/// Cuts a message into pieces: the first takes at most the free bytes of a chunk, the others fill one chunk each, and
/// the last is the remainder.
///
///     | first_bytes | piece_bytes | piece_bytes | ... | remainder |      `count` pieces, `bytes` in total
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

#include "session/messages.hpp"

namespace tactus::session {

struct MessagePieces {
  std::uint32_t bytes = 0;
  std::uint16_t first_bytes = 0, piece_bytes = 0;
  std::uint32_t count = 1;

  /// Cuts `bytes` of a region, or of a base mesh, so that the first piece fits into `free_bytes` bytes of a chunk, and each
  /// other piece into a chunk of `chunk_bytes`.
  [[nodiscard]] static MessagePieces cut(std::uint32_t bytes, std::uint32_t region, std::size_t free_bytes,
                                         std::size_t chunk_bytes = kMaxPayload) noexcept {
    const auto max_pieces = static_cast<std::uint32_t>(bytes / (chunk_bytes / 2) + 2);
    const std::size_t max_header = header_bytes(region, max_pieces);
    MessagePieces pieces;
    pieces.bytes = bytes;
    pieces.piece_bytes = static_cast<std::uint16_t>(chunk_bytes - max_header);
    pieces.first_bytes = static_cast<std::uint16_t>(std::min<std::size_t>(bytes, free_bytes - max_header));
    const std::uint32_t rest = bytes - pieces.first_bytes;
    pieces.count = 1 + rest / pieces.piece_bytes + (rest % pieces.piece_bytes != 0 ? 1 : 0);
    return pieces;
  }
  /// First byte of a piece in the message, and the byte after its last.
  [[nodiscard]] std::pair<std::size_t, std::size_t> range(std::uint32_t piece) const noexcept {
    if (piece == 0) return {0, first_bytes};
    const std::size_t from = first_bytes + std::size_t{piece_bytes} * (piece - 1u);
    return {from, std::min<std::size_t>(from + piece_bytes, bytes)};
  }
};

}  // namespace tactus::session
