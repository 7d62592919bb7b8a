#include "tools/scene/base_meshes.hpp"

#include <utility>

#include "spm/codec/base_codec.hpp"

namespace tactus::scene {

/// Subtracts the pieces of a message from the count of bytes.
void BaseMeshes::forget(const Message& message) {
  for (const auto& [index, bytes] : message.pieces) bytes_ -= bytes.size() + kPieceBytes;
}

std::optional<spm::BaseMesh> BaseMeshes::add(const session::BulkChunk& chunk) {
  if (chunk.kind() != session::BulkKind::kBase || known_.size() >= kMaxModels) return std::nullopt;
  for (const session::BulkPiece& piece : chunk.pieces) {
    Message& message = messages_[chunk.stream];
    if (message.count != piece.count || message.checksum != piece.checksum) {  // a new message
      forget(message);
      message = {piece.count, piece.checksum, {}};
    }
    const auto [place, is_new] = message.pieces.try_emplace(piece.index, piece.payload);
    if (is_new) bytes_ += piece.payload.size() + kPieceBytes;
    if (message.pieces.size() < message.count) continue;
    std::vector<std::uint8_t> joined;
    for (const auto& [index, bytes] : message.pieces) joined.insert(joined.end(), bytes.begin(), bytes.end());
    forget(message);
    messages_.erase(chunk.stream);
    if (session::checksum_of(joined) != piece.checksum) continue;
    auto decoded = spm::codec::decode_base(joined);
    if (decoded && known_.insert(decoded->mesh.summary.digest).second) return std::move(decoded->mesh);
  }
  if (bytes_ > kMaxBytes) {
    messages_.clear();
    bytes_ = 0;
  }
  return std::nullopt;
}

}  // namespace tactus::scene
