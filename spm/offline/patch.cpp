#include "spm/offline/patch.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "spm/model.hpp"

namespace tactus::spm::offline {
namespace {

/// Maximum number of faces around the target of a collapse. At a vertex of very many faces, the work would be
/// quadratic.
constexpr std::uint32_t kMaxTargetStar = 1024;
constexpr float kBorderWeight = 10;
constexpr float kLengthWeight = 1e-6f;  // makes short edges of a flat surface collapse first

std::uint32_t face_of(std::uint32_t corner) { return corner / 4; }

struct Point {
  double x, y, z;
};
Point point(const Offset& p) { return {p[0], p[1], p[2]}; }
Point operator-(const Point& a, const Point& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
double dot(const Point& a, const Point& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
Point cross(const Point& a, const Point& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

}  // namespace

Offset unit_normal(const std::array<Offset, 3>& triangle, float& length) {
  const Point a = point(triangle[0]);
  const Point normal = cross(point(triangle[1]) - a, point(triangle[2]) - a);
  const double norm = std::sqrt(dot(normal, normal));
  length = static_cast<float>(norm);
  if (!(length > 0)) return {0, 0, 0};
  return {static_cast<float>(normal.x / norm), static_cast<float>(normal.y / norm),
          static_cast<float>(normal.z / norm)};
}

void add_border_plane(Quadric& quadric, const Offset& edge, const Offset& normal) {
  const Point along = point(edge), opposite = cross(along, point(normal));
  const double length = std::sqrt(dot(opposite, opposite));
  if (!(length > 0)) return;
  quadric.add_plane({static_cast<float>(opposite.x / length), static_cast<float>(opposite.y / length),
                     static_cast<float>(opposite.z / length)},
                    kBorderWeight * static_cast<float>(dot(along, along)));
}

Patch::Patch(Surface& surface, const SimplifyOptions& options) : surface_{surface}, options_{options} {
  static_assert(kRingCapacity <= kMaxChanges);
  options_.max_star = std::min(options_.max_star, kRingCapacity - 2);
}

Segment Patch::simplify(const PatchTask& task, const std::function<void(double)>& progress) {
  const auto distance = static_cast<float>(options_.pair_distance * double{surface_.scale});
  pair_distance2_ = task.is_last_round ? distance * distance : 0;
  load(task);
  const std::uint32_t start = alive_;
  // A collapse may make others legal, so the last round repeats until nothing changes.
  for (std::size_t before = kNone; before != out_.sequence.size();) {
    before = out_.sequence.size();
    fill_queue(task.is_first_round && before == 0);
    for (std::uint32_t at = queue_.cheapest(); at != CostQueue::kAbsent && alive_ > task.target;
         at = queue_.cheapest()) {
      const std::uint32_t u = queue_.front(at);
      queue_.remove(u);
      const std::size_t done = out_.sequence.size();
      try_vertex(u);
      if (progress && out_.sequence.size() != done && done % 4096 == 0) {
        progress(double(start - alive_) / double(start - task.target));
      }
    }
    if (!task.is_last_round) break;
  }
  store();
  out_.sequence.push_back({kNone, kNone, static_cast<std::uint32_t>(out_.removed_faces.size()),
                           static_cast<std::uint32_t>(out_.moved.size())});
  Segment result = out_;  // copies without spare capacity
  out_.sequence.clear();
  out_.removed_faces.clear();
  out_.removed_third_corners.clear();
  out_.moved.clear();
  return result;
}

void Patch::load(const PatchTask& task) {
  const std::span<const std::uint32_t> faces = task.faces;
  vertices_.clear();
  shared_.clear();
  for (const std::uint32_t f : faces) {
    for (const std::uint32_t v : surface_.corners[f]) {
      if (surface_.owner[v] != task.block) shared_.push_back({v, kNone});
    }
  }
  std::sort(shared_.begin(), shared_.end());
  shared_.erase(std::unique(shared_.begin(), shared_.end()), shared_.end());
  faces_.resize(faces.size());
  for (std::size_t i = 0; i < faces.size(); ++i) {
    Face& face = faces_[i];
    face.id = faces[i];
    face.is_alive = true;
    face.is_changed = (surface_.state[face.id] & Surface::kChanged) != 0;
    for (std::size_t k = 0; k < 3; ++k) face.corner[k] = local_number(surface_.corners[face.id][k], task.block);
  }
  quadrics_.assign(vertices_.size(), Quadric{});
  for (Face& face : faces_) load_normal(face, task.is_first_round);
  if (!task.is_first_round) {
    for (std::uint32_t v = 0; v < vertices_.size(); ++v) {
      if (vertices_[v].is_inner) quadrics_[v] = surface_.quadrics[vertices_[v].id];
    }
  }
  alive_ = static_cast<std::uint32_t>(faces_.size());
  ring_position_.assign(vertices_.size(), 0);
  queue_.reset(static_cast<std::uint32_t>(vertices_.size()));
  build_stars();
  if (pair_distance2_ > 0) fill_grid();
}

/// Returns the index of a vertex in `vertices_`. Adds the vertex if it is new.
std::uint32_t Patch::local_number(std::uint32_t vertex, std::uint32_t block) {
  const bool is_inner = surface_.owner[vertex] == block;
  std::uint32_t* number = &surface_.local_number[vertex];
  if (!is_inner) {
    number = &std::lower_bound(shared_.begin(), shared_.end(), std::pair{vertex, 0u})->second;
    if (*number != kNone) return *number;
  } else if (*number < vertices_.size() && vertices_[*number].id == vertex) {
    return *number;
  }
  *number = static_cast<std::uint32_t>(vertices_.size());
  vertices_.push_back({surface_.scaled(vertex), 0, 0, 0, vertex, is_inner, false});
  return *number;
}

void Patch::load_normal(Face& face, bool is_first_round) {
  float length = 0;
  if (is_first_round) {
    face.normal =
        unit_normal({vertices_[face.corner[0]].at, vertices_[face.corner[1]].at, vertices_[face.corner[2]].at}, length);
    for (const std::uint32_t v : face.corner) quadrics_[v].add_plane(face.normal, length / 2);
  } else {
    const Triangle& f = surface_.finest.faces[face.id];
    face.normal = unit_normal({surface_.scaled(f[0]), surface_.scaled(f[1]), surface_.scaled(f[2])}, length);
  }
}

void Patch::build_stars() {
  for (const Face& face : faces_) {
    for (const std::uint32_t v : face.corner) ++vertices_[v].capacity;
  }
  std::uint32_t sum = 0;
  for (Vertex& vertex : vertices_) {
    if (!vertex.is_inner) continue;
    vertex.star = sum;
    sum += vertex.capacity;
  }
  corners_.resize(sum);
  for (std::uint32_t f = 0; f < faces_.size(); ++f) {
    for (std::uint32_t k = 0; k < 3; ++k) {
      Vertex& vertex = vertices_[faces_[f].corner[k]];
      if (vertex.is_inner) corners_[vertex.star + vertex.size++] = 4 * f + k;
    }
  }
}

void Patch::store() {
  for (const Face& face : faces_) {
    Triangle& corners = surface_.corners[face.id];
    for (std::size_t k = 0; k < 3; ++k) corners[k] = vertices_[face.corner[k]].id;
    surface_.state[face.id] =
        static_cast<std::uint8_t>((face.is_alive ? Surface::kAlive : 0) | (face.is_changed ? Surface::kChanged : 0));
  }
  for (std::uint32_t v = 0; v < vertices_.size(); ++v) {
    if (vertices_[v].is_inner && !vertices_[v].is_removed) surface_.quadrics[vertices_[v].id] = quadrics_[v];
  }
}

void Patch::fill_queue(bool is_first_round) {
  for (std::uint32_t u = 0; u < vertices_.size(); ++u) {
    if (!vertices_[u].is_inner || vertices_[u].is_removed) continue;
    build_ring(u);
    if (is_first_round) add_border_planes(u);
    gather_candidates(u);
    float best = std::numeric_limits<float>::infinity();
    for (const Candidate& candidate : candidates_) best = std::min(best, candidate.cost);
    if (!candidates_.empty()) queue_.push(u, CostQueue::class_of(best));
    clear_ring();
  }
}

/// Adds a plane to the quadric of v for each border edge at v. The plane is perpendicular to the face of the edge.
void Patch::add_border_planes(std::uint32_t v) {
  for (std::uint32_t i = 0; i < ring_.size; ++i) {
    if (ring_.degree[i] != 1) continue;
    const std::uint32_t w = ring_.vertex[i];
    for (const std::uint32_t corner : star(v)) {
      const Face& face = faces_[face_of(corner)];
      if (face.corner[0] != w && face.corner[1] != w && face.corner[2] != w) continue;
      add_border_plane(quadrics_[v], between(vertices_[v].at, vertices_[w].at), face.normal);
    }
  }
}

float Patch::cost(std::uint32_t u, std::uint32_t t) const {
  const Offset e = between(vertices_[u].at, vertices_[t].at);
  const float length2 = e[0] * e[0] + e[1] * e[1] + e[2] * e[2];
  return std::max(quadrics_[u].at(e), 0.0f) + kLengthWeight * length2 * length2;
}

/// Collects the vertices to which u may collapse, by the form of its star and by the distance of pairs.
void Patch::gather_candidates(std::uint32_t u) {
  candidates_.clear();
  const Star star = ring_.star;
  for (std::uint32_t i = 0; i < ring_.size; ++i) {
    const std::uint32_t t = ring_.vertex[i];
    if (!vertices_[t].is_inner) continue;
    const bool by_star = star == Star::kDisc || star == Star::kPinched || (star == Star::kFan && ring_.degree[i] == 1);
    if (by_star || is_within_pair_distance(u, t)) candidates_.push_back({cost(u, t), t});
  }
  if (pair_distance2_ > 0 && ring_.size > 0) gather_pairs(u);
}

/// Collects the vertices without an edge to u that are within the distance of pairs, and no further from u than its
/// longest edge.
void Patch::gather_pairs(std::uint32_t u) {
  float reach2 = 0;
  for (std::uint32_t i = 0; i < ring_.size; ++i) {
    const Offset e = between(vertices_[u].at, vertices_[ring_.vertex[i]].at);
    reach2 = std::max(reach2, e[0] * e[0] + e[1] * e[1] + e[2] * e[2]);
  }
  reach2 = std::min(reach2, pair_distance2_);
  const double reach = std::sqrt(double{reach2});
  std::array<std::uint32_t, 3> low{}, high{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    low[axis] = grid_coordinate(vertices_[u].at[axis] - reach);
    high[axis] = grid_coordinate(vertices_[u].at[axis] + reach);
  }
  for (std::uint32_t x = low[0]; x <= high[0]; ++x) {
    for (std::uint32_t y = low[1]; y <= high[1]; ++y) {
      const auto end = std::pair{grid_key(x, y, high[2]), None::kValue};
      for (auto at = std::lower_bound(grid_.begin(), grid_.end(), std::pair{grid_key(x, y, low[2]), 0u});
           at != grid_.end() && *at <= end; ++at) {
        const std::uint32_t t = at->second;
        if (t == u || vertices_[t].is_removed || vertices_[t].size == 0 || in_ring(t) < ring_.size) continue;
        const Offset e = between(vertices_[u].at, vertices_[t].at);
        if (e[0] * e[0] + e[1] * e[1] + e[2] * e[2] <= reach2) candidates_.push_back({cost(u, t), t});
      }
    }
  }
}

void Patch::fill_grid() {
  double sum = 0;
  for (const Face& face : faces_) {
    const Point along = point(between(vertices_[face.corner[0]].at, vertices_[face.corner[1]].at));
    sum += std::sqrt(dot(along, along));
  }
  const double edge = sum / static_cast<double>(faces_.size());
  cell_ = std::max(std::min(std::sqrt(double{pair_distance2_}), 2 * edge), 1e-30);
  grid_.clear();
  for (std::uint32_t v = 0; v < vertices_.size(); ++v) {
    if (!vertices_[v].is_inner) continue;
    const Offset& p = vertices_[v].at;
    grid_.push_back({grid_key(grid_coordinate(p[0]), grid_coordinate(p[1]), grid_coordinate(p[2])), v});
  }
  std::sort(grid_.begin(), grid_.end());
}

/// Coordinates outside the grid belong to its outermost cells.
std::uint32_t Patch::grid_coordinate(double x) const {
  constexpr double kHalf = 1 << 20;
  return static_cast<std::uint32_t>(std::clamp(std::floor(x / cell_), -kHalf, kHalf - 1) + kHalf);
}

std::uint64_t Patch::grid_key(std::uint32_t x, std::uint32_t y, std::uint32_t z) {
  return std::uint64_t{x} << 42 | std::uint64_t{y} << 21 | z;
}

/// True if u and t may collapse with or without an edge between them.
bool Patch::is_within_pair_distance(std::uint32_t u, std::uint32_t t) const {
  const Offset e = between(vertices_[u].at, vertices_[t].at);
  return e[0] * e[0] + e[1] * e[1] + e[2] * e[2] < pair_distance2_;
}

/// Collapses u, a vertex of the cheapest class, to its cheapest candidate that is legal. The class of u in the queue is
/// a lower bound: if the cost of the candidate is in a more expensive class than the next vertex, u returns to the
/// queue with that class.
void Patch::try_vertex(std::uint32_t u) {
  build_ring(u);
  gather_candidates(u);
  const std::uint32_t next_class = queue_.cheapest();
  for (auto first = candidates_.begin(); first != candidates_.end(); ++first) {
    std::iter_swap(first, std::min_element(first, candidates_.end(), [](const Candidate& a, const Candidate& b) {
                     return a.cost != b.cost ? a.cost < b.cost : a.t < b.t;
                   }));
    const std::uint32_t cost_class = CostQueue::class_of(first->cost);
    if (cost_class > next_class) {
      queue_.push(u, cost_class);
      break;
    }
    if (!is_legal_collapse(u, first->t)) continue;
    collapse(u, first->t);
    break;
  }
  clear_ring();
}

void Patch::build_ring(std::uint32_t u) {
  ring_.size = 0;
  ring_.star = Star::kLocked;
  if (vertices_[u].size == 0 || vertices_[u].size > options_.max_star) return;
  std::uint32_t max = 0, ends = 0;
  for (const std::uint32_t corner : star(u)) {
    const Face& face = faces_[face_of(corner)];
    const std::uint32_t k = corner % 4;
    const std::uint32_t a = ring_index(face.corner[(k + 1) % 3]), b = ring_index(face.corner[(k + 2) % 3]);
    if (ring_.degree[a] < 2) ring_.neighbours[a][ring_.degree[a]] = static_cast<std::uint8_t>(b);
    if (ring_.degree[b] < 2) ring_.neighbours[b][ring_.degree[b]] = static_cast<std::uint8_t>(a);
    max = std::max<std::uint32_t>({max, ++ring_.degree[a], ++ring_.degree[b]});
  }
  for (std::uint32_t i = 0; i < ring_.size; ++i) ends += static_cast<std::uint32_t>(ring_.degree[i] == 1);
  const bool one_sheet = max <= 2 && ring_.size >= 3 - ends / 2 && is_connected();
  if (one_sheet && ends == 2) {
    ring_.star = Star::kFan;
  } else if (ends == 0) {
    ring_.star = one_sheet ? Star::kDisc : Star::kPinched;
  }
}

std::uint32_t Patch::ring_index(std::uint32_t v) {
  if (ring_position_[v] == 0) {
    ring_.vertex[ring_.size] = v;
    ring_.degree[ring_.size] = 0;
    ring_position_[v] = static_cast<std::uint8_t>(++ring_.size);
  }
  return ring_position_[v] - 1u;
}

void Patch::clear_ring() {
  for (std::uint32_t i = 0; i < ring_.size; ++i) ring_position_[ring_.vertex[i]] = 0;
}

/// True if the ring is connected. Every vertex of the ring must have one or two neighbours.
bool Patch::is_connected() const {
  std::uint32_t start = 0;
  for (std::uint32_t i = 0; i < ring_.size; ++i) {
    if (ring_.degree[i] == 1) start = i;
  }
  std::uint32_t visited = 1, before = start, at = ring_.neighbours[start][0];
  while (at != start) {
    ++visited;
    if (ring_.degree[at] == 1) break;
    const std::uint32_t onward = ring_.neighbours[at][ring_.neighbours[at][0] == before ? 1 : 0];
    before = at;
    at = onward;
  }
  return visited == ring_.size;
}

bool Patch::is_legal_collapse(std::uint32_t u, std::uint32_t t) const {
  const std::uint32_t size = vertices_[t].size, at = in_ring(t);
  const std::uint32_t removed_faces = at < ring_.size ? ring_.degree[at] : 0;
  if (size > kMaxTargetStar) return false;
  if (vertices_[u].size + size - 2 * removed_faces > std::max(options_.max_star, size)) return false;
  if (!preserves_shapes(u, t)) return false;
  if (is_within_pair_distance(u, t)) return preserves_faces(u, t);
  return ring_.star == Star::kPinched ? preserves_sheets(u, t) : preserves_surface(u, at);
}

/// For a disc or fan: true if the link condition holds and no face or component vanishes, except the faces at the edge
/// from u to t. t is at position `at` of the ring.
bool Patch::preserves_surface(std::uint32_t u, std::uint32_t at) const {
  const std::uint32_t removed_faces = ring_.degree[at];
  const auto is_apex = [&](std::uint32_t i) {  // the third corner of a face at the edge from u to t
    return ring_.neighbours[at][0] == i || (removed_faces == 2 && ring_.neighbours[at][1] == i);
  };
  bool apex_has_other_face = ring_.size > 2;  // if u has one face only, the third corner of this face needs another one
  for (const std::uint32_t corner : star(ring_.vertex[at])) {
    const Face& face = faces_[face_of(corner)];
    const std::uint32_t k = corner % 4;
    const std::uint32_t a = face.corner[(k + 1) % 3], b = face.corner[(k + 2) % 3];
    if (a == u || b == u) continue;
    const std::uint32_t ia = in_ring(a), ib = in_ring(b);
    if (ia < ring_.size && !is_apex(ia)) return false;
    if (ib < ring_.size && !is_apex(ib)) return false;
    if (ia < ring_.size || ib < ring_.size) apex_has_other_face = true;
    if (ia < ring_.size && ib < ring_.size && ring_.size == 3) return false;  // the new face exists already
  }
  return apex_has_other_face;
}

/// For a pinched star, whose sheets touch at u. True under three conditions. u and t share only neighbours that are
/// third corners of faces at the edge from u to t. No face coincides with another. The number of faces at an edge does
/// not grow beyond 2 or its previous maximum, and does not become 0. Sheets may separate: sheets that touched along an
/// edge may touch at a vertex afterwards.
bool Patch::preserves_sheets(std::uint32_t u, std::uint32_t t) const {
  std::array<std::uint32_t, kRingCapacity> between_them{}, at_target{};
  for (const std::uint32_t corner : star(t)) {
    const Face& face = faces_[face_of(corner)];
    const std::uint32_t k = corner % 4;
    const std::uint32_t a = face.corner[(k + 1) % 3], b = face.corner[(k + 2) % 3];
    const std::uint32_t ia = a == u ? ring_.size : in_ring(a), ib = b == u ? ring_.size : in_ring(b);
    if (ia < ring_.size) ++at_target[ia];
    if (ib < ring_.size) ++at_target[ib];
    if (a == u) ++between_them[ib];
    if (b == u) ++between_them[ia];
    if (ia < ring_.size && ib < ring_.size && has_face(u, a, b)) return false;
  }
  for (std::uint32_t i = 0; i < ring_.size; ++i) {
    if (ring_.vertex[i] == t || at_target[i] == 0) continue;
    if (between_them[i] == 0) return false;
    const std::uint32_t faces = ring_.degree[i] + at_target[i] - 2 * between_them[i];
    if (faces == 0 || faces > std::max<std::uint32_t>({2, ring_.degree[i], at_target[i]})) return false;
  }
  return true;
}

/// For a pair: true if no face coincides with another, no vertex loses its last face, and the number of faces at an
/// edge does not grow beyond 4 or its previous maximum.
bool Patch::preserves_faces(std::uint32_t u, std::uint32_t t) const {
  std::array<std::uint32_t, kRingCapacity> removed_faces{}, at_target{};
  std::uint32_t left = vertices_[u].size + vertices_[t].size;
  for (const std::uint32_t corner : star(t)) {
    const Face& face = faces_[face_of(corner)];
    const std::uint32_t k = corner % 4;
    const std::uint32_t a = face.corner[(k + 1) % 3], b = face.corner[(k + 2) % 3];
    const std::uint32_t ia = a == u ? ring_.size : in_ring(a), ib = b == u ? ring_.size : in_ring(b);
    if (ia < ring_.size) ++at_target[ia];
    if (ib < ring_.size) ++at_target[ib];
    if (a == u) ++removed_faces[ib];
    if (b == u) ++removed_faces[ia];
    if (a == u || b == u) left -= 2;
    if (ia < ring_.size && ib < ring_.size && has_face(u, a, b)) return false;
  }
  for (std::uint32_t i = 0; i < ring_.size; ++i) {
    const std::uint32_t w = ring_.vertex[i];
    if (w == t || at_target[i] == 0) continue;
    const std::uint32_t faces = ring_.degree[i] + at_target[i] - 2 * removed_faces[i];
    if (faces > std::max<std::uint32_t>({4, ring_.degree[i], at_target[i]})) return false;
    if (removed_faces[i] > 0 && faces == 0 && (!vertices_[w].is_inner || vertices_[w].size == removed_faces[i]))
      return false;
  }
  return left > 0;
}

/// True if a face of u has a and b as corners.
bool Patch::has_face(std::uint32_t u, std::uint32_t a, std::uint32_t b) const {
  const std::span<const std::uint32_t> corners = star(u);
  return std::any_of(corners.begin(), corners.end(), [&](std::uint32_t corner) {
    const std::array<std::uint32_t, 3>& c = faces_[face_of(corner)].corner;
    const std::uint32_t k = corner % 4, next = c[(k + 1) % 3], before = c[(k + 2) % 3];
    return (next == a && before == b) || (next == b && before == a);
  });
}

/// True if every face that moves with u meets SimplifyOptions::min_cosine and min_shape.
bool Patch::preserves_shapes(std::uint32_t u, std::uint32_t t) const {
  const Point target = point(vertices_[t].at), old = point(vertices_[u].at);
  for (const std::uint32_t corner : star(u)) {
    const Face& face = faces_[face_of(corner)];
    const std::uint32_t k = corner % 4;
    const std::uint32_t va = face.corner[(k + 1) % 3], vb = face.corner[(k + 2) % 3];
    if (va == t || vb == t) continue;
    const Point a = point(vertices_[va].at), b = point(vertices_[vb].at), ab = b - a, at = target - a, bt = target - b;
    const Point normal = cross(ab, at);
    const double along = dot(normal, point(face.normal)), area2 = dot(normal, normal);
    if (!(along > 0 && along * along > options_.min_cosine * options_.min_cosine * area2)) return false;
    const double ab2 = dot(ab, ab), edges = ab2 + dot(at, at) + dot(bt, bt);
    if (12 * area2 >= options_.min_shape * options_.min_shape * edges * edges) continue;
    const Point au = old - a, bu = old - b, old_normal = cross(ab, au);
    const double old_edges = ab2 + dot(au, au) + dot(bu, bu);
    if (!(area2 * old_edges * old_edges >= dot(old_normal, old_normal) * edges * edges)) return false;
  }
  return true;
}

void Patch::collapse(std::uint32_t u, std::uint32_t t) {
  out_.sequence.push_back({vertices_[u].id, vertices_[t].id, static_cast<std::uint32_t>(out_.removed_faces.size()),
                           static_cast<std::uint32_t>(out_.moved.size())});
  reserve_star(t, vertices_[t].size + vertices_[u].size);
  for (const std::uint32_t corner : star(u)) {
    Face& face = faces_[face_of(corner)];
    const std::uint32_t k = corner % 4;
    const std::uint32_t next = face.corner[(k + 1) % 3], before = face.corner[(k + 2) % 3];
    if (next == t || before == t) {
      const bool t_is_next = next == t;
      const std::uint32_t x = t_is_next ? before : next;
      out_.removed_faces.push_back(BornRef::make(FaceId{face.id}, t_is_next ? 0 : 1, !face.is_changed));
      out_.removed_third_corners.push_back(vertices_[x].id);
      face.is_alive = false;
      --alive_;
      remove_corner(t, face_of(corner));
      if (vertices_[x].is_inner) remove_corner(x, face_of(corner));
    } else {
      out_.moved.emplace_back(face.id, !face.is_changed);
      face.corner[k] = t;
      corners_[vertices_[t].star + vertices_[t].size++] = corner;
    }
    face.is_changed = true;
  }
  quadrics_[t].add(quadrics_[u], between(vertices_[u].at, vertices_[t].at));
  vertices_[u].is_removed = true;
  for (std::uint32_t i = 0; i < ring_.size; ++i) {
    const std::uint32_t w = ring_.vertex[i];
    if (!vertices_[w].is_inner || w == t) continue;
    const std::uint32_t class_to_t = CostQueue::class_of(cost(w, t));
    if (class_to_t < queue_.class_of_vertex(w)) queue_.push(w, class_to_t);
  }
  if (queue_.class_of_vertex(t) == CostQueue::kAbsent) queue_.push(t, 0);
}

/// Removes from the star of v the corner of a face.
void Patch::remove_corner(std::uint32_t v, std::uint32_t face) {
  std::uint32_t* corner = corners_.data() + vertices_[v].star;
  while (face_of(*corner) != face) ++corner;
  *corner = corners_[vertices_[v].star + --vertices_[v].size];
}

/// Makes room for `size` corners in the star of v; may move the star to the end of `corners_`.
void Patch::reserve_star(std::uint32_t v, std::uint32_t size) {
  Vertex& vertex = vertices_[v];
  if (vertex.capacity >= size) return;
  const auto to = static_cast<std::uint32_t>(corners_.size());
  corners_.resize(corners_.size() + size + size / 2);
  std::copy_n(corners_.begin() + vertex.star, vertex.size, corners_.begin() + to);
  vertex.star = to;
  vertex.capacity = size + size / 2;
}

}  // namespace tactus::spm::offline
