#include "spm/offline/simplify.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <queue>

#include "spm/ids.hpp"
#include "spm/model.hpp"

namespace tactus::spm::offline {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr std::uint32_t kRingCapacity = 128;
constexpr std::uint32_t kMaxTargetStar =
    1024;  // looking at the hub of a wide fan once for each spoke would be quadratic
constexpr double kBorderWeight = 10;
constexpr double kLengthWeight = 1e-6;  // on flat ground, short edges first

/// Sum of weighted squared distances to planes, as a symmetric 4x4 form.
struct Quadric {
  double xx = 0, xy = 0, xz = 0, xw = 0, yy = 0, yz = 0, yw = 0, zz = 0, zw = 0, ww = 0;

  void add_plane(const Vec3d& normal, double offset, double weight) {
    const double x = normal[0], y = normal[1], z = normal[2], w = offset;
    xx += weight * x * x;
    xy += weight * x * y;
    xz += weight * x * z;
    xw += weight * x * w;
    yy += weight * y * y;
    yz += weight * y * z;
    yw += weight * y * w;
    zz += weight * z * z;
    zw += weight * z * w;
    ww += weight * w * w;
  }
  void add(const Quadric& q) {
    xx += q.xx;
    xy += q.xy;
    xz += q.xz;
    xw += q.xw;
    yy += q.yy;
    yz += q.yz;
    yw += q.yw;
    zz += q.zz;
    zw += q.zw;
    ww += q.ww;
  }
  [[nodiscard]] double at(const Vec3d& p) const {
    const double x = p[0], y = p[1], z = p[2];
    return x * (xx * x + 2 * (xy * y + xz * z + xw)) + y * (yy * y + 2 * (yz * z + yw)) + z * (zz * z + 2 * zw) + ww;
  }
};

/// The vertices around u, in no order, and how u's faces join them: faces are the edges of this graph.
enum class Star {
  kDisc,     ///< one closed ring
  kFan,      ///< one open chain: u is on a border
  kPinched,  ///< anything else without a border: sheets that touch in u or along an edge of it
  kLocked,   ///< anything else
};
struct Ring {
  std::uint32_t size = 0;
  Star star = Star::kLocked;
  std::array<std::uint32_t, kRingCapacity> vertex;
  std::array<std::uint8_t, kRingCapacity> degree;                 ///< faces on the edge from u
  std::array<std::array<std::uint8_t, 2>, kRingCapacity> joined;  ///< the first two

  [[nodiscard]] std::uint32_t find(std::uint32_t v) const {
    std::uint32_t i = 0;
    while (i < size && vertex[i] != v) ++i;
    return i;
  }
};

struct Candidate {
  double cost;
  std::uint32_t at;  ///< in the ring
};

class Simplifier {
 public:
  Simplifier(const TriangleMesh& mesh, const SimplifyOptions& options) : mesh_{mesh}, options_{options} {
    options_.max_star = std::min(options_.max_star, kRingCapacity - 2);
    const std::size_t vertices = mesh.positions.size(), faces = mesh.faces.size();
    alive_faces_ = static_cast<std::uint32_t>(faces);
    normalise();
    link_corners();
    star_size_.assign(vertices, 0);
    for (const Triangle& f : mesh.faces) {
      for (const std::uint32_t v : f) ++star_size_[v];
    }
    quadrics_.resize(vertices);
    normals_.resize(faces);
    for (std::uint32_t f = 0; f < faces; ++f) add_face_plane(f);
    for (std::uint32_t v = 0; v < vertices; ++v) add_border_planes(v);
    gone_.assign(vertices, 0);
    key_.assign(vertices, kInfinity);
    out_.sequence.reserve(vertices);
    out_.dying.reserve(faces);
    out_.moved.reserve(4 * vertices);
  }

  Collapses run(const std::function<void(double)>& progress) {
    const std::uint32_t start = alive_faces_;
    // A collapse may make another legal that was not: again from the start until a round brings nothing.
    for (std::size_t before = kNone; before != out_.sequence.size();) {
      before = out_.sequence.size();
      push_all();
      while (!heap_.empty() && alive_faces_ > options_.base_faces) {
        const std::size_t done = out_.sequence.size();
        step();
        if (progress && out_.sequence.size() != done && done % 4096 == 0) {
          progress(double(start - alive_faces_) / double(start - options_.base_faces));
        }
      }
    }
    out_.corners.resize(rows_.size());
    out_.alive.resize(rows_.size());
    for (std::size_t f = 0; f < rows_.size(); ++f) {
      out_.corners[f] = {rows_[f].corner[0], rows_[f].corner[1], rows_[f].corner[2]};
      out_.alive[f] = rows_[f].alive;
    }
    return std::move(out_);
  }

 private:
  struct Row {
    std::array<std::uint32_t, 3> corner;
    std::uint8_t alive, touched;
  };
  struct Entry {
    double key;
    std::uint32_t vertex;
    bool operator<(const Entry& other) const {  // the standard heap has its greatest first
      return key != other.key ? key > other.key : vertex > other.vertex;
    }
  };

  static std::uint32_t face_of(std::uint32_t corner) { return corner / 4; }

  Vec3d position(std::uint32_t v) const {
    const std::array<float, 3>& p = mesh_.positions[v];
    return {p[0], p[1], p[2]};
  }
  Vec3d centred(std::uint32_t v) const { return (position(v) - centre_) * scale_; }

  void normalise() {
    Vec3d low = Vec3d::Constant(kInfinity), high = Vec3d::Constant(-kInfinity);
    for (std::uint32_t v = 0; v < mesh_.positions.size(); ++v) {
      low = low.cwiseMin(position(v));
      high = high.cwiseMax(position(v));
    }
    if (mesh_.positions.empty()) return;
    centre_ = (low + high) / 2;
    const double size = (high - low).maxCoeff();
    scale_ = size > 0 ? 1 / size : 1;
  }

  void link_corners() {
    rows_.resize(mesh_.faces.size());
    head_.assign(mesh_.positions.size(), kNone);
    tail_.assign(mesh_.positions.size(), kNone);
    next_.assign(4 * mesh_.faces.size(), kNone);
    for (std::uint32_t f = 0; f < rows_.size(); ++f) {
      rows_[f] = {mesh_.faces[f], 1, 0};
      for (std::uint32_t k = 0; k < 3; ++k) append(mesh_.faces[f][k], 4 * f + k, 4 * f + k);
    }
  }

  void append(std::uint32_t v, std::uint32_t first, std::uint32_t last) {
    if (tail_[v] == kNone) {
      head_[v] = first;
    } else {
      next_[tail_[v]] = first;
    }
    tail_[v] = last;
  }

  /// The corners of living faces that stand at v; drops the others from its list.
  void gather(std::uint32_t v, std::vector<std::uint32_t>& star) {
    star.clear();
    std::uint32_t* link = &head_[v];
    std::uint32_t last = kNone;
    while (*link != kNone) {
      const std::uint32_t corner = *link;
      if (rows_[face_of(corner)].alive == 0) {
        *link = next_[corner];
        continue;
      }
      star.push_back(corner);
      last = corner;
      link = &next_[corner];
    }
    tail_[v] = last;
  }

  void add_face_plane(std::uint32_t f) {
    const Triangle& t = mesh_.faces[f];
    const Vec3d a = centred(t[0]);
    Vec3d normal = (centred(t[1]) - a).cross(centred(t[2]) - a);
    const double length = normal.norm();
    normals_[f] = Vec3f::Zero();
    if (!(length > 0)) return;
    normal /= length;
    normals_[f] = normal.cast<float>();
    for (const std::uint32_t v : t) quadrics_[v].add_plane(normal, -normal.dot(a), length / 2);
  }

  /// A plane upright on the face along each border edge at v, so that moving v off the border costs.
  void add_border_planes(std::uint32_t v) {
    if (star_size_[v] > kMaxTargetStar) return;
    gather(v, star_);
    for (const std::uint32_t corner : star_) {
      const std::uint32_t f = face_of(corner), k = corner % 4;
      for (const std::uint32_t w : {mesh_.faces[f][(k + 1) % 3], mesh_.faces[f][(k + 2) % 3]}) {
        std::uint32_t uses = 0;
        for (const std::uint32_t other : star_) {
          const Triangle& t = mesh_.faces[face_of(other)];
          uses += static_cast<std::uint32_t>(t[0] == w || t[1] == w || t[2] == w);
        }
        if (uses != 1) continue;
        const Vec3d a = centred(v), edge = centred(w) - a;
        Vec3d across = edge.cross(normals_[f].cast<double>());
        const double length = across.norm();
        if (!(length > 0)) continue;
        across /= length;
        quadrics_[v].add_plane(across, -across.dot(a), kBorderWeight * edge.squaredNorm());
      }
    }
  }

  void push(std::uint32_t v, double key) {
    key_[v] = key;
    heap_.push({key, v});
  }

  void push_all() {
    for (std::uint32_t v = 0; v < key_.size(); ++v) {
      if (gone_[v] != 0 || !build_ring(v)) continue;
      double best = kInfinity;
      for (std::uint32_t i = 0; i < ring_.size; ++i) best = std::min(best, cost(v, ring_.vertex[i]));
      push(v, best);
    }
  }

  double cost(std::uint32_t u, std::uint32_t t) const {
    const Vec3d at = centred(t);
    const double length2 = (at - centred(u)).squaredNorm();
    return std::max(quadrics_[u].at(at), 0.0) + kLengthWeight * length2 * length2;
  }

  /// Looks at the vertex whose cheapest collapse may be the cheapest of all. Keys are lower bounds: a vertex that turns
  /// out dearer goes back with what it really costs.
  void step() {
    const Entry top = heap_.top();
    heap_.pop();
    const std::uint32_t u = top.vertex;
    if (gone_[u] != 0 || key_[u] != top.key) return;
    while (!heap_.empty() && stale(heap_.top())) heap_.pop();
    const double rival = heap_.empty() ? kInfinity : heap_.top().key;
    key_[u] = kInfinity;
    if (!build_ring(u)) return;

    std::array<Candidate, kRingCapacity> candidates;
    std::uint32_t count = 0;
    for (std::uint32_t i = 0; i < ring_.size; ++i) {
      if (ring_.star != Star::kFan || ring_.degree[i] == 1) candidates[count++] = {cost(u, ring_.vertex[i]), i};
    }
    for (std::uint32_t first = 0; first < count; ++first) {
      const auto dearer = [this](const Candidate& a, const Candidate& b) {
        return a.cost != b.cost ? a.cost < b.cost : ring_.vertex[a.at] < ring_.vertex[b.at];
      };
      std::iter_swap(&candidates[first], std::min_element(&candidates[first], candidates.data() + count, dearer));
      if (candidates[first].cost > rival) return push(u, candidates[first].cost);
      if (legal(u, candidates[first].at)) return collapse(u, ring_.vertex[candidates[first].at]);
    }
  }

  bool stale(const Entry& entry) const { return gone_[entry.vertex] != 0 || key_[entry.vertex] != entry.key; }

  /// False when u has to stay where it is.
  bool build_ring(std::uint32_t u) {
    ring_.size = 0;
    if (star_size_[u] == 0 || star_size_[u] > options_.max_star) return false;
    gather(u, star_);
    std::uint32_t most = 0, ends = 0;
    for (const std::uint32_t corner : star_) {
      const Row& row = rows_[face_of(corner)];
      const std::uint32_t k = corner % 4;
      const std::uint32_t a = ring_index(row.corner[(k + 1) % 3]), b = ring_index(row.corner[(k + 2) % 3]);
      if (ring_.degree[a] < 2) ring_.joined[a][ring_.degree[a]] = static_cast<std::uint8_t>(b);
      if (ring_.degree[b] < 2) ring_.joined[b][ring_.degree[b]] = static_cast<std::uint8_t>(a);
      most = std::max<std::uint32_t>({most, ++ring_.degree[a], ++ring_.degree[b]});
    }
    for (std::uint32_t i = 0; i < ring_.size; ++i) ends += static_cast<std::uint32_t>(ring_.degree[i] == 1);
    const bool one_sheet = most <= 2 && ring_.size >= 3 - ends / 2 && is_connected();
    if (one_sheet && ends == 2) {
      ring_.star = Star::kFan;
    } else if (ends == 0) {
      ring_.star = one_sheet ? Star::kDisc : Star::kPinched;
    } else {
      ring_.star = Star::kLocked;
    }
    return ring_.star != Star::kLocked;
  }

  /// Whether one walk along the ring, where every vertex has two neighbours or is an end, meets all of it.
  bool is_connected() const {
    std::uint32_t start = 0;
    for (std::uint32_t i = 0; i < ring_.size; ++i) {
      if (ring_.degree[i] == 1) start = i;
    }
    std::uint32_t visited = 1, before = start, at = ring_.joined[start][0];
    while (at != start) {
      ++visited;
      if (ring_.degree[at] == 1) break;
      const std::uint32_t onward = ring_.joined[at][ring_.joined[at][0] == before ? 1 : 0];
      before = at;
      at = onward;
    }
    return visited == ring_.size;
  }

  std::uint32_t ring_index(std::uint32_t v) {
    const std::uint32_t i = ring_.find(v);
    if (i == ring_.size) {
      ring_.vertex[i] = v;
      ring_.degree[i] = 0;
      ++ring_.size;
    }
    return i;
  }

  bool legal(std::uint32_t u, std::uint32_t at) {
    const std::uint32_t t = ring_.vertex[at];
    if (star_size_[t] > kMaxTargetStar) return false;
    if (star_size_[u] + star_size_[t] - 2 * ring_.degree[at] > std::max(options_.max_star, star_size_[t])) return false;
    if (!keeps_shapes(u, t)) return false;
    gather(t, target_star_);
    return ring_.star == Star::kPinched ? keeps_sheets(u, t) : keeps_surface(u, at);
  }

  /// The link condition for a disc or fan, and no face or component lost beyond the faces between u and t.
  bool keeps_surface(std::uint32_t u, std::uint32_t at) {
    const std::uint32_t dying = ring_.degree[at];
    const auto apex = [&](std::uint32_t i) {
      return ring_.joined[at][0] == i || (dying == 2 && ring_.joined[at][1] == i);
    };
    bool apex_has_other_face = ring_.size > 2;  // an ear's only face goes: something else must hold its apex
    for (const std::uint32_t corner : target_star_) {
      const Row& row = rows_[face_of(corner)];
      const std::uint32_t k = corner % 4;
      const std::uint32_t a = row.corner[(k + 1) % 3], b = row.corner[(k + 2) % 3];
      if (a == u || b == u) continue;
      const std::uint32_t ia = ring_.find(a), ib = ring_.find(b);
      if (ia < ring_.size && !apex(ia)) return false;
      if (ib < ring_.size && !apex(ib)) return false;
      if (ia < ring_.size || ib < ring_.size) apex_has_other_face = true;
      if (ia < ring_.size && ib < ring_.size && ring_.size == 3) return false;  // the new face is there already
    }
    return apex_has_other_face;
  }

  /// The same where sheets touch in u: u and t share no neighbour but the apexes of the faces between them, no face
  /// comes to lie on another, and no edge comes to have more faces than u and t had there, or none. Sheets may come
  /// apart: what touched along an edge may touch in a vertex afterwards.
  bool keeps_sheets(std::uint32_t u, std::uint32_t t) {
    std::array<std::uint32_t, kRingCapacity> between{}, at_target{};
    for (const std::uint32_t corner : target_star_) {
      const Row& row = rows_[face_of(corner)];
      const std::uint32_t k = corner % 4;
      const std::uint32_t a = row.corner[(k + 1) % 3], b = row.corner[(k + 2) % 3];
      const std::uint32_t ia = a == u ? ring_.size : ring_.find(a), ib = b == u ? ring_.size : ring_.find(b);
      if (ia < ring_.size) ++at_target[ia];
      if (ib < ring_.size) ++at_target[ib];
      if (a == u) ++between[ib];
      if (b == u) ++between[ia];
      if (ia < ring_.size && ib < ring_.size && has_face(a, b)) return false;
    }
    for (std::uint32_t i = 0; i < ring_.size; ++i) {
      if (ring_.vertex[i] == t || at_target[i] == 0) continue;
      if (between[i] == 0) return false;
      const std::uint32_t faces = ring_.degree[i] + at_target[i] - 2 * between[i];
      if (faces == 0 || faces > std::max<std::uint32_t>({2, ring_.degree[i], at_target[i]})) return false;
    }
    return true;
  }

  /// Whether a face of u's star holds both a and b.
  bool has_face(std::uint32_t a, std::uint32_t b) const {
    return std::any_of(star_.begin(), star_.end(), [&](std::uint32_t corner) {
      const Triangle& c = rows_[face_of(corner)].corner;
      const std::uint32_t k = corner % 4, next = c[(k + 1) % 3], before = c[(k + 2) % 3];
      return (next == a && before == b) || (next == b && before == a);
    });
  }

  bool keeps_shapes(std::uint32_t u, std::uint32_t t) const {
    const Vec3d target = position(t), old = position(u);
    for (const std::uint32_t corner : star_) {
      const Row& row = rows_[face_of(corner)];
      const std::uint32_t k = corner % 4;
      const std::uint32_t va = row.corner[(k + 1) % 3], vb = row.corner[(k + 2) % 3];
      if (va == t || vb == t) continue;
      const Vec3d a = position(va), b = position(vb), ab = b - a;
      const Vec3d normal = ab.cross(target - a);
      const double length = normal.norm();
      const double along = normal.dot(normals_[face_of(corner)].cast<double>());
      if (!(along > options_.min_cosine * length)) return false;
      const double edges = ab.squaredNorm() + (target - a).squaredNorm() + (target - b).squaredNorm();
      const double shape = 2 * std::sqrt(3.0) * length / edges;
      if (shape >= options_.min_shape) continue;
      const double old_edges = ab.squaredNorm() + (old - a).squaredNorm() + (old - b).squaredNorm();
      if (!(shape >= 2 * std::sqrt(3.0) * ab.cross(old - a).norm() / old_edges)) return false;
    }
    return true;
  }

  void collapse(std::uint32_t u, std::uint32_t t) {
    Collapse note{u, t, static_cast<std::uint32_t>(out_.dying.size()), 0, static_cast<std::uint32_t>(out_.moved.size()),
                  0};
    for (const std::uint32_t corner : star_) {
      const std::uint32_t f = face_of(corner), k = corner % 4;
      Row& row = rows_[f];
      const bool finest = row.touched == 0;
      row.touched = 1;
      const std::uint32_t next = row.corner[(k + 1) % 3], before = row.corner[(k + 2) % 3];
      if (next == t || before == t) {
        const bool t_is_next = next == t;
        out_.dying.push_back(
            {f, t_is_next ? before : next, static_cast<std::uint8_t>(2 * k + (t_is_next ? 0 : 1)), finest});
        row.alive = 0;
        --star_size_[t];
        --star_size_[t_is_next ? before : next];
      } else {
        ++star_size_[t];
        out_.moved.push_back({f, static_cast<std::uint8_t>(k), finest});
        row.corner[k] = t;
      }
    }
    note.dying_count = static_cast<std::uint32_t>(out_.dying.size()) - note.first_dying;
    note.moved_count = static_cast<std::uint32_t>(out_.moved.size()) - note.first_moved;
    alive_faces_ -= note.dying_count;
    out_.sequence.push_back(note);
    append(t, head_[u], tail_[u]);
    quadrics_[t].add(quadrics_[u]);
    gone_[u] = 1;
    for (std::uint32_t i = 0; i < ring_.size; ++i) {
      const std::uint32_t w = ring_.vertex[i];
      const double through_t = w == t ? 0 : cost(w, t);
      if (w == t ? key_[t] == kInfinity : through_t < key_[w]) push(w, through_t);
    }
  }

  const TriangleMesh& mesh_;
  SimplifyOptions options_;
  Vec3d centre_ = Vec3d::Zero();
  double scale_ = 1;
  std::uint32_t alive_faces_ = 0;
  std::vector<Row> rows_;
  std::vector<Vec3f> normals_;  // of the finest faces; zero where there is none
  // A vertex's corners (4 * face + corner) as a linked list; those of vanished faces leave when next gathered.
  std::vector<std::uint32_t> head_, tail_, next_;
  std::vector<std::uint32_t> star_size_;
  std::vector<Quadric> quadrics_;
  std::vector<std::uint8_t> gone_;
  std::vector<double> key_;  // the vertex's valid entry in the heap; infinity: none
  std::priority_queue<Entry> heap_;
  Ring ring_;
  std::vector<std::uint32_t> star_, target_star_;
  Collapses out_;
};

}  // namespace

Collapses simplify(const TriangleMesh& mesh, const SimplifyOptions& options,
                   const std::function<void(double)>& progress) {
  return Simplifier{mesh, options}.run(progress);
}

}  // namespace tactus::spm::offline
