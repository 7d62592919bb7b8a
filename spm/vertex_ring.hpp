/// The vertices around a split, in the one order that sender and receiver share: t, then for each deformed corner the
/// two other corners of its face, then third corners named by id; each once.
///
/// A record depends on all of them, so whoever can take the record has them. They name the third corners of born faces
/// and let expect where u is (PositionPredictor). In ids or slots alike.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm {

class VertexRing {
 public:
  /// Vertices beyond these are left out.
  static constexpr std::uint32_t kMax = 64;

  void add(std::uint32_t vertex) noexcept {
    if (count_ < kMax && find(vertex) == count_) vertices_[count_++] = vertex;
  }
  /// The place of `vertex`; size() when it is not there.
  [[nodiscard]] std::uint32_t find(std::uint32_t vertex) const noexcept {
    std::uint32_t i = 0;
    while (i < count_ && vertices_[i] != vertex) ++i;
    return i;
  }
  [[nodiscard]] std::uint32_t size() const noexcept { return count_; }
  [[nodiscard]] std::uint32_t operator[](std::uint32_t i) const noexcept { return vertices_[i]; }

 private:
  std::uint32_t count_ = 0;
  std::array<std::uint32_t, kMax> vertices_;
};

}  // namespace tactus::spm
