/// Joins the pieces of base meshes that a recorder receives, and decodes them.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "session/messages.hpp"
#include "spm/model.hpp"

namespace tactus::scene {

/// The base meshes that are complete, and the pieces of the others.
///
/// Each host sends its base mesh to each HRTC in a stream of its own. The pieces of two streams can have other sizes, so
/// each stream is joined alone. No DDS, thread or clock. Samples are not trusted: memory is limited.
class BaseMeshes {
 public:
  /// Max bytes of all pieces of messages that are not complete. When they exceed this, all are dropped.
  static constexpr std::size_t kMaxBytes = 64u << 20;
  /// Bytes that a piece counts in addition to its payload, because tiny pieces take memory too.
  static constexpr std::size_t kPieceBytes = 128;
  /// Max number of models. The base meshes of others are not decoded.
  static constexpr std::size_t kMaxModels = 1024;

  /// Applies a chunk. Returns the base mesh that it completes; none if there is no such, or its model is known.
  [[nodiscard]] std::optional<spm::BaseMesh> add(const session::BulkChunk& chunk);
  /// Bytes of the pieces of incomplete messages.
  [[nodiscard]] std::size_t bytes() const noexcept { return bytes_; }

 private:
  struct Message {
    std::uint32_t count = 0, checksum = 0;
    std::map<std::uint32_t, std::vector<std::uint8_t>> pieces;  // by index
  };
  void forget(const Message& message);

  std::map<std::uint32_t, Message> messages_;  // incomplete, by stream
  std::size_t bytes_ = 0;                      // of their pieces
  std::set<std::uint64_t> known_;              // digests of the models of complete messages
};

}  // namespace tactus::scene
