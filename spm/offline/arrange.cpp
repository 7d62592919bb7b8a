#include "spm/offline/arrange.hpp"

#include <array>
#include <utility>
#include <vector>

namespace tactus::spm::offline {
namespace {

using Corners = std::array<std::uint32_t, 3>;

void turn_faces(const ModelSummary& summary, Span<RecordPart> parts) {
  std::vector<std::uint8_t> turned(summary.faces, 0);
  for (RecordPart& part : parts) {
    for (int i = 0; i < part.born_count; ++i) {
      const BornRef born = part.born[i];
      turned[born.face()] = static_cast<std::uint8_t>(born.order() / 2);
      part.born[i] = BornRef::make(born.face(), born.order() % 2, born.last());
    }
  }
  for (RecordPart& part : parts) {
    for (int i = 0; i < part.deformed_count; ++i) {
      const DeformedRef ref = part.deformed[i];
      part.deformed[i] = DeformedRef::make(ref.face(), (ref.corner() + 3u - turned[ref.face()]) % 3, ref.last());
    }
  }
}

/// Each face after the one whose last edge is its first; a fan begins with the face that follows none.
void order_fan(RecordPart& part, const std::vector<Corners>& corners) {
  struct Edge {
    std::uint32_t from, to;  // of the face, opposite t
  };
  std::array<Edge, kDeformedPerPart> edges;
  const int count = part.deformed_count;
  for (int i = 0; i < count; ++i) {
    const Corners& at = corners[part.deformed[i].face()];
    edges[i] = {at[(part.deformed[i].corner() + 1) % 3], at[(part.deformed[i].corner() + 2) % 3]};
  }
  for (int i = 0; i < count; ++i) {
    const auto follows = [&](int j) { return i > 0 && edges[j].from == edges[i - 1].to; };
    const auto begins = [&](int j) {
      for (int k = i; k < count; ++k) {
        if (edges[k].to == edges[j].from) return false;
      }
      return true;
    };
    int next = i;
    while (next < count && !follows(next)) ++next;
    if (next == count) next = i;
    while (next < count && !follows(next) && !begins(next)) ++next;
    if (next == count) continue;
    std::swap(edges[i], edges[next]);
    std::swap(part.deformed[i], part.deformed[next]);
  }
  if (part.born_count == 2 && part.born[0].order() > part.born[1].order()) {
    std::swap(part.born[0], part.born[1]);
    std::swap(part.born_x[0], part.born_x[1]);
  }
}

}  // namespace

void arrange_faces(const ModelSummary& summary, Span<const BaseFace> base_faces, Span<RecordPart> parts) {
  turn_faces(summary, parts);
  std::vector<Corners> corners(summary.faces);
  for (const BaseFace& face : base_faces) corners[face.face] = face.corners;
  for (std::uint32_t r = 0; r < summary.records; ++r) {
    const std::uint32_t u = summary.base_vertices + r;
    order_fan(parts[r], corners);
    for (std::uint32_t p = r; p != kNone; p = parts[p].next) {
      const RecordPart& part = parts[p];
      for (int i = 0; i < part.born_count; ++i) {
        corners[part.born[i].face()] = part.born[i].order() == 0 ? Corners{u, part.parent, part.born_x[i]}
                                                                 : Corners{u, part.born_x[i], part.parent};
      }
      for (int i = 0; i < part.deformed_count; ++i) corners[part.deformed[i].face()][part.deformed[i].corner()] = u;
    }
  }
}

}  // namespace tactus::spm::offline
