/// The ring of a split: the vertices around the split, each once, in an order that sender and receiver share. t comes
/// first. Each part of the record then adds the two other corners of its deformed faces, and the third corners that the
/// record names by id.
///
/// A record depends on all vertices of its ring, so every receiver that can decode the record has them. A record can
/// therefore name the third corners of born faces by their positions in the ring, and PositionPredictor can predict the
/// position of u from the ring.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm {

template <class Vertex>
class VertexRing {
 public:
  /// Max size; further vertices are not added.
  static constexpr std::uint32_t kMax = 64;

  void add(Vertex vertex) noexcept {
    if (count_ < kMax && find(vertex) == count_) vertices_[count_++] = vertex;
  }
  /// The position of `vertex` in the ring, or size().
  [[nodiscard]] std::uint32_t find(Vertex vertex) const noexcept {
    std::uint32_t i = 0;
    while (i < count_ && vertices_[i] != vertex) ++i;
    return i;
  }
  [[nodiscard]] std::uint32_t size() const noexcept { return count_; }
  [[nodiscard]] Vertex operator[](std::uint32_t i) const noexcept { return vertices_[i]; }

 private:
  std::uint32_t count_ = 0;
  std::array<Vertex, kMax> vertices_;
};

}  // namespace tactus::spm
