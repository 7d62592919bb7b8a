#include "spm/offline/arrange.hpp"

#include <utility>

namespace tactus::spm::offline {

void order_fan(std::span<DeformedRef> fan, const std::vector<Triangle>& corners) {
  // The start and the end of the edge opposite to the vertex.
  const auto from = [&](std::size_t i) { return corners[index(fan[i].face())][(fan[i].corner() + 1) % 3]; };
  const auto to = [&](std::size_t i) { return corners[index(fan[i].face())][(fan[i].corner() + 2) % 3]; };
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

void arrange_faces(const ModelSummary& summary, std::span<RecordPart> parts) {
  IdVector<FaceId, std::uint8_t> rotation{summary.faces};
  for (RecordPart& part : parts) {
    for (int i = 0; i < part.born_count; ++i) {
      const BornRef born = part.born[i];
      rotation[born.face()] = static_cast<std::uint8_t>(born.order() / 2);
      part.born[i] = BornRef::make(born.face(), born.order() % 2, born.is_finest());
    }
    if (part.born_count == 2 && part.born[0].order() > part.born[1].order()) {
      std::swap(part.born[0], part.born[1]);
      std::swap(part.born_x[0], part.born_x[1]);
    }
  }
  for (RecordPart& part : parts) {
    for (int i = 0; i < part.deformed_count; ++i) {
      const DeformedRef ref = part.deformed[i];
      part.deformed[i] = DeformedRef::make(ref.face(), (ref.corner() + 3u - rotation[ref.face()]) % 3, ref.is_finest());
    }
  }
}

}  // namespace tactus::spm::offline
