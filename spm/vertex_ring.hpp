/// The vertices around a split, in an order that sender and receiver share: t, then for each deformed corner the two
/// other corners of its face, then the third corners that are named by id; each vertex once.
///
/// A record depends on all of them, so every receiver that can decode the record has them. A record names the third
/// corners of born faces by their position in the ring, and the ring predicts the position of u (PositionPredictor).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm {

template <class Vertex>
class VertexRing {
 public:
  /// Further vertices are left out.
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
