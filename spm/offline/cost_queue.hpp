/// A queue of vertices in classes by the cost of their removal. There are eight classes from each power of two to the
/// next; within a class, the vertex that waits longest comes first.
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
  static constexpr std::uint32_t kAbsent = kClasses;  ///< the class of a vertex that is not in the queue

  /// The class of a cost, which must not be negative. Infinity and NaN are in the last class.
  [[nodiscard]] static std::uint32_t class_of(float cost) {
    if (!(cost < 3e38f)) return kClasses - 1;
    std::uint32_t bits = 0;
    std::memcpy(&bits, &cost, sizeof bits);
    return bits >> 20;  // the exponent and three bits below it
  }

  /// Empties the queue and sets the number of vertices.
  void reset(std::uint32_t vertices) {
    links_.assign(vertices, {kNone, kNone, kAbsent});
    first_.fill(kNone);
    last_.fill(kNone);
    words_.fill(0);
  }
  /// The class of a vertex, or kAbsent.
  [[nodiscard]] std::uint32_t class_of_vertex(std::uint32_t v) const { return links_[v].cost_class; }

  /// Adds v at the end of a class, and removes it from its previous class.
  void push(std::uint32_t v, std::uint32_t cost_class) {
    remove(v);
    Link& link = links_[v];
    link = {last_[cost_class], kNone, cost_class};
    (link.previous == kNone ? first_[cost_class] : links_[link.previous].next) = v;
    last_[cost_class] = v;
    words_[cost_class / 64] |= std::uint64_t{1} << cost_class % 64;
  }
  void remove(std::uint32_t v) {
    Link& link = links_[v];
    const std::uint32_t cost_class = link.cost_class;
    if (cost_class == kAbsent) return;
    (link.previous == kNone ? first_[cost_class] : links_[link.previous].next) = link.next;
    (link.next == kNone ? last_[cost_class] : links_[link.next].previous) = link.previous;
    if (first_[cost_class] == kNone) words_[cost_class / 64] &= ~(std::uint64_t{1} << cost_class % 64);
    link.cost_class = kAbsent;
  }
  /// The cheapest class that has a vertex; kAbsent if the queue is empty.
  [[nodiscard]] std::uint32_t cheapest() const {
    for (std::uint32_t w = 0; w < words_.size(); ++w) {
      if (words_[w] != 0) return 64 * w + static_cast<std::uint32_t>(std::countr_zero(words_[w]));
    }
    return kAbsent;
  }
  /// The first vertex of a class, or kNone.
  [[nodiscard]] std::uint32_t front(std::uint32_t cost_class) const { return first_[cost_class]; }

 private:
  struct Link {
    std::uint32_t previous, next, cost_class;
  };
  std::vector<Link> links_;  // by vertex
  std::array<std::uint32_t, kClasses> first_{}, last_{};
  std::array<std::uint64_t, kClasses / 64> words_{};  // one bit for each class: it has a vertex
};

}  // namespace tactus::spm::offline
