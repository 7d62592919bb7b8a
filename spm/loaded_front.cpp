#include "spm/loaded_front.hpp"

#include <algorithm>

#include "spm/pool.hpp"

namespace tactus::spm {

template <class Face, class Vertex, class Stored>
void LoadedFront<Face, Vertex, Stored>::link(std::span<const Face> faces) {
  struct Edge {
    std::uint64_t ends;  // the two vertices, the lower index first
    std::uint32_t at;
    bool ascends;  // the edge goes from the lower to the higher index
  };
  std::vector<Edge> edges;
  edges.reserve(3 * faces.size());
  for (const Face face : faces) {
    for (std::uint32_t corner = 0; corner < 3; ++corner) {
      const std::uint32_t from = index(corners(face)[next_corner(corner)]),
                          to = index(corners(face)[previous_corner(corner)]);
      edges.push_back(
          {std::uint64_t{std::min(from, to)} << 32 | std::max(from, to), number({face, corner}), from < to});
    }
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& a, const Edge& b) { return a.ends < b.ends; });
  for (std::size_t i = 0, end = 0; i < edges.size(); i = end) {
    while (end < edges.size() && edges[end].ends == edges[i].ends) ++end;
    if (end == i + 2 && edges[i].ascends != edges[i + 1].ascends) link(edges[i].at, edges[i + 1].at);
  }
}

template <class Face, class Vertex, class Stored>
void LoadedFront<Face, Vertex, Stored>::link_split(const Split& split) noexcept {
  if (split.deformed_count_ > Split::kMaxDeformed || split.born_count_ > Split::kMaxBorn) return;
  using Born = typename Split::Born;
  const auto at = [](const Born& born, int corner) { return number({born.face, static_cast<std::uint32_t>(corner)}); };
  for (std::uint32_t i = 0; i < split.born_count_; ++i) {
    const Born& born = split.born_[i];
    const Vertex x = corners(born.face)[static_cast<std::size_t>(born.at.x)];
    CornerRef side{};  // the corner of f opposite to the edge (u, x)
    int found = 0;
    for (std::uint32_t k = 0; k < split.deformed_count_; ++k) {
      const CornerRef d = split.deformed_[k];
      if (corners(d.face)[born.even ? next_corner(d.corner) : previous_corner(d.corner)] != x) continue;
      side = {d.face, born.even ? previous_corner(d.corner) : next_corner(d.corner)};
      ++found;
    }
    if (found != 1) continue;
    link(at(born, born.at.u), opposite(number(side)));  // across (t, x) is g
    link(at(born, born.at.t), number(side));            // across (u, x) is f
  }
  if (split.born_count_ == 2 && split.born_[0].even != split.born_[1].even) {
    link(at(split.born_[0], split.born_[0].at.x), at(split.born_[1], split.born_[1].at.x));
  }
}

template <class Face, class Vertex, class Stored>
void LoadedFront<Face, Vertex, Stored>::unlink(Face face, std::uint32_t order) noexcept {
  const BornCorners at = born_corners(order);
  const Links links = opposite_[face];
  const std::uint32_t inner = links[static_cast<std::size_t>(at.t)], outer = links[static_cast<std::size_t>(at.u)];
  link(inner, outer);
  link(links[static_cast<std::size_t>(at.x)], kNone);
}

template class LoadedFront<RowIndex, Slot, PackedSlot>;
template class LoadedFront<FaceId, VertexId>;

ModelFront base_front(const ModelSummary& summary, std::span<const BaseFace> base_faces) {
  ModelFront front{summary.faces};
  std::vector<FaceId> faces;
  faces.reserve(base_faces.size());
  for (const BaseFace& face : base_faces) {
    front.set(face.face, face.corners);
    faces.push_back(face.face);
  }
  front.link(std::span<const FaceId>{faces});
  return front;
}

}  // namespace tactus::spm
