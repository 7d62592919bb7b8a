/// Vertices by the cost of their removal: eight classes to a power of two, first in first out within a class.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <vector>

#include "spm/ids.hpp"

namespace tactus::spm::offline {

class CostQueue {
 public:
  static constexpr std::uint32_t kClasses = 2048;
  static constexpr std::uint32_t kAbsent = kClasses;

  /// The class of a cost that is not negative. Infinity and NaN are in the last class.
  [[nodiscard]] static std::uint32_t class_of(float cost) {
    if (!(cost < 3e38f)) return kClasses - 1;
    std::uint32_t bits = 0;
    std::memcpy(&bits, &cost, sizeof bits);
    return bits >> 20;  // the exponent and three bits below it
  }

  void reset(std::uint32_t vertices) {
    links_.assign(vertices, {kNone, kNone, kAbsent});
    first_.fill(kNone);
    last_.fill(kNone);
    words_.fill(0);
  }
  /// The class of a vertex, or kAbsent.
  [[nodiscard]] std::uint32_t class_of_vertex(std::uint32_t v) const { return links_[v].in; }

  /// Moves v to the end of a class, or adds it there.
  void push(std::uint32_t v, std::uint32_t cost_class) {
    remove(v);
    Link& link = links_[v];
    link = {last_[cost_class], kNone, cost_class};
    (link.before == kNone ? first_[cost_class] : links_[link.before].next) = v;
    last_[cost_class] = v;
    words_[cost_class / 64] |= std::uint64_t{1} << cost_class % 64;
  }
  void remove(std::uint32_t v) {
    Link& link = links_[v];
    if (link.in == kAbsent) return;
    (link.before == kNone ? first_[link.in] : links_[link.before].next) = link.next;
    (link.next == kNone ? last_[link.in] : links_[link.next].before) = link.before;
    if (first_[link.in] == kNone) words_[link.in / 64] &= ~(std::uint64_t{1} << link.in % 64);
    link.in = kAbsent;
  }
  /// The cheapest class with a vertex, or kAbsent.
  [[nodiscard]] std::uint32_t cheapest() const {
    for (std::uint32_t w = 0; w < words_.size(); ++w) {
      if (words_[w] != 0) return 64 * w + static_cast<std::uint32_t>(std::countr_zero(words_[w]));
    }
    return kAbsent;
  }
  [[nodiscard]] std::uint32_t front(std::uint32_t cost_class) const { return first_[cost_class]; }

 private:
  struct Link {
    std::uint32_t before, next, in;
  };
  std::vector<Link> links_;  // by vertex
  std::array<std::uint32_t, kClasses> first_{}, last_{};
  std::array<std::uint64_t, kClasses / 64> words_{};  // a bit for each class with a vertex
};

}  // namespace tactus::spm::offline
