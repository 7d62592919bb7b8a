#include "spm/offline/arrange.hpp"

#include <utility>

namespace tactus::spm::offline {

void order_fan(std::span<MovedCorner> fan, const std::vector<Triangle>& corners) {
  // The start and the end of the edge opposite to the vertex.
  const auto from = [&](std::size_t i) { return corners[fan[i].face()][(fan[i].corner() + 1) % 3]; };
  const auto to = [&](std::size_t i) { return corners[fan[i].face()][(fan[i].corner() + 2) % 3]; };
  const std::size_t count = fan.size();
  for (std::size_t i = 0; i < count; ++i) {
    const auto begins_fan = [&](std::size_t j) {
      for (std::size_t k = i; k < count; ++k) {
        if (to(k) == from(j)) return false;
      }
      return true;
    };
    std::size_t next = i;
    while (next < count && (i == 0 || from(next) != to(i - 1))) ++next;
    if (next == count) {
      next = i;
      while (next < count && !begins_fan(next)) ++next;
    }
    if (next < count) std::swap(fan[i], fan[next]);
  }
}

}  // namespace tactus::spm::offline
