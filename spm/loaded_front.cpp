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
  const auto at_u = [](const Born& born) { return number({born.face, 0}); };
  const auto at_t = [](const Born& born) { return number({born.face, corner_of_t(born.order)}); };
  const auto at_x = [](const Born& born) { return number({born.face, corner_of_x(born.order)}); };
  for (std::uint32_t i = 0; i < split.born_count_; ++i) {
    const Born& born = split.born_[i];
    const Vertex x = corners(born.face)[corner_of_x(born.order)];
    CornerRef side{};  // the corner of f opposite to the edge (u, x)
    int found = 0;
    for (std::uint32_t k = 0; k < split.deformed_count_; ++k) {
      const CornerRef d = split.deformed_[k];
      if (corners(d.face)[born.order == 0 ? next_corner(d.corner) : previous_corner(d.corner)] != x) continue;
      side = {d.face, born.order == 0 ? previous_corner(d.corner) : next_corner(d.corner)};
      ++found;
    }
    if (found != 1) continue;
    link(at_u(born), opposite(number(side)));  // across (t, x) is g
    link(at_t(born), number(side));            // across (u, x) is f
  }
  if (split.born_count_ == 2 && split.born_[0].order != split.born_[1].order) {
    link(at_x(split.born_[0]), at_x(split.born_[1]));
  }
}

template <class Face, class Vertex, class Stored>
void LoadedFront<Face, Vertex, Stored>::unlink(Face face, std::uint32_t order) noexcept {
  const Links links = opposite_[face];
  link(links[corner_of_t(order)], links[0]);
  link(links[corner_of_x(order)], kNone);
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
