#include "spm/loaded_front.hpp"

#include <algorithm>

namespace tactus::spm {

void LoadedFront::link(Span<const std::uint32_t> faces) {
  struct Edge {
    std::uint64_t ends;  // the lower one first
    std::uint32_t at;
    bool ascends;
  };
  std::vector<Edge> edges;
  edges.reserve(3 * faces.size());
  for (const std::uint32_t face : faces) {
    for (std::uint32_t corner = 0; corner < 3; ++corner) {
      const std::uint32_t from = corners(face)[after(corner)], to = corners(face)[before(corner)];
      edges.push_back(
          {std::uint64_t{std::min(from, to)} << 32 | std::max(from, to), number({face, corner}), from < to});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) { return a.ends < b.ends; });
  for (std::size_t i = 0, end = 0; i < edges.size(); i = end) {
    while (end < edges.size() && edges[end].ends == edges[i].ends) ++end;
    if (end == i + 2 && edges[i].ascends != edges[i + 1].ascends) meet(edges[i].at, edges[i + 1].at);
  }
}

void LoadedFront::join(const Split& split) noexcept {
  if (split.deformed_count_ > Split::kMaxDeformed || split.born_count_ > Split::kMaxBorn) return;
  const auto at = [](const Split::Born& born, int corner) {
    return number({born.face, static_cast<std::uint32_t>(corner)});
  };
  for (std::uint32_t i = 0; i < split.born_count_; ++i) {
    const Split::Born& born = split.born_[i];
    const std::uint32_t x = corners(born.face)[static_cast<std::size_t>(born.at.x)];
    At side{};
    int found = 0;
    for (std::uint32_t k = 0; k < split.deformed_count_; ++k) {
      const At d = split.deformed_[k];
      if (corners(d.face)[born.even ? after(d.corner) : before(d.corner)] != x) continue;
      side = {d.face, born.even ? before(d.corner) : after(d.corner)};
      ++found;
    }
    if (found != 1) continue;
    meet(at(born, born.at.u), opposite(side));
    meet(at(born, born.at.t), number(side));
  }
  if (split.born_count_ == 2 && split.born_[0].even != split.born_[1].even) {
    meet(at(split.born_[0], split.born_[0].at.x), at(split.born_[1], split.born_[1].at.x));
  }
}

void LoadedFront::take_out(std::uint32_t face, std::uint32_t order) noexcept {
  const BornCorners at = born_corners(order);
  const std::array<std::uint32_t, 3> links = faces_[face].opposite;
  const std::uint32_t inner = links[static_cast<std::size_t>(at.t)], outer = links[static_cast<std::size_t>(at.u)];
  const std::uint32_t name_conflict = links[static_cast<std::size_t>(at.x)];
  if (inner != kNone) faces_[inner >> 2].opposite[inner & 3u] = outer;
  if (outer != kNone) faces_[outer >> 2].opposite[outer & 3u] = inner;
  if (name_conflict != kNone) faces_[name_conflict >> 2].opposite[name_conflict & 3u] = kNone;
}

LoadedFront base_front(const ModelSummary& summary, Span<const BaseFace> base_faces) {
  LoadedFront front{summary.faces};
  std::vector<std::uint32_t> faces;
  faces.reserve(base_faces.size());
  for (const BaseFace& face : base_faces) {
    front.set(face.face, face.corners);
    faces.push_back(face.face);
  }
  front.link(faces);
  return front;
}

}  // namespace tactus::spm
