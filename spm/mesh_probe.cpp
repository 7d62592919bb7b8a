#include "spm/mesh_probe.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>

namespace tactus::spm {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Allowance for float rounding, as a share of the max coordinate of a query. Exceeds the sum of all rounding errors of
/// a box or of a height above a plane.
constexpr float kSlack = 3e-6f;

/// Height divided by longest edge of a triangle. Thinner triangles have no reliable normal.
constexpr double kThin = 1e-6;

}  // namespace

MeshProbe::MeshProbe(std::span<const std::array<float, 3>> vertices,
                     std::span<const std::array<std::uint32_t, 3>> triangles) {
  if (triangles.empty() || triangles.size() > kMaxTriangles) {
    throw std::invalid_argument("MeshProbe: " + std::to_string(triangles.size()) + " triangles, expected 1 to " +
                                std::to_string(kMaxTriangles));
  }
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const Vec3d p{vertices[v][0], vertices[v][1], vertices[v][2]};
    if (!p.allFinite()) throw std::invalid_argument("MeshProbe: vertex " + std::to_string(v) + " is not finite");
    for (int axis = 0; axis < 3; ++axis) vertices_[axis].push_back(p[axis]);
    radius_ = std::max(radius_, p.norm());
  }
  vertex_count_ = vertices.size();
  for (std::vector<double>& filled : vertices_) filled.resize((filled.size() + 7) / 8 * 8, 0);
  for (std::size_t t = 0; t < triangles.size(); ++t)
    for (const std::uint32_t corner : triangles[t])
      if (corner >= vertices.size()) {
        throw std::invalid_argument("MeshProbe: triangle " + std::to_string(t) + " has corner " +
                                    std::to_string(corner) + ", expected below " + std::to_string(vertices.size()));
      }
  std::vector<std::uint32_t> order(triangles.size());
  std::iota(order.begin(), order.end(), 0u);
  int height = 1;
  while ((std::uint64_t{1} << 3 * height) < order.size()) ++height;
  root_ = build(order, 0, static_cast<std::uint32_t>(order.size()), height, triangles);
}

std::uint32_t MeshProbe::build(std::vector<std::uint32_t>& order, std::uint32_t first, std::uint32_t last, int height,
                               std::span<const std::array<std::uint32_t, 3>> triangles) {
  // Divides the triangles into parts of 8^(height - 1), of which the last can be smaller. Halves them repeatedly along
  // the longest axis of the box of their centres.
  const std::uint32_t part = 1u << 3 * (height - 1);
  const auto centre = [&](std::uint32_t t, int axis) {
    const std::vector<double>& at = vertices_[axis];
    return at[triangles[t][0]] + at[triangles[t][1]] + at[triangles[t][2]];
  };
  const auto divide = [&](const auto& self, std::uint32_t from, std::uint32_t to) -> void {
    const std::uint32_t parts = (to - from + part - 1) / part;
    if (parts < 2) return;
    const std::uint32_t middle = from + parts / 2 * part;
    int longest = 0;
    double length = -1;
    for (int axis = 0; axis < 3; ++axis) {
      double low = centre(order[from], axis), high = low;
      for (std::uint32_t i = from; i < to; ++i) {
        low = std::min(low, centre(order[i], axis));
        high = std::max(high, centre(order[i], axis));
      }
      if (high - low <= length) continue;
      length = high - low;
      longest = axis;
    }
    std::sort(order.begin() + from, order.begin() + to, [&](std::uint32_t a, std::uint32_t b) {
      const double at = centre(a, longest), bt = centre(b, longest);
      return at != bt ? at < bt : a < b;
    });
    self(self, from, middle);
    self(self, middle, to);
  };
  divide(divide, first, last);

  Node node{};
  node.leaf = height == 1;
  for (int axis = 0; axis < 3; ++axis) {
    std::fill_n(node.low[axis], kWidth, kInfinity);
    std::fill_n(node.high[axis], kWidth, -kInfinity);
    node.whole_low[axis] = kInfinity;
    node.whole_high[axis] = -kInfinity;
  }
  for (std::uint32_t from = first; from < last; from += part) {
    const std::uint32_t k = node.count++;
    if (node.leaf) {
      const std::array<std::uint32_t, 3>& corners = triangles[order[from]];
      node.child[k] = static_cast<std::uint32_t>(corners_.size());
      corners_.push_back(corners);
      number_.push_back(order[from]);
      Triangle3d t;
      for (int i = 0; i < 3; ++i) {
        for (int axis = 0; axis < 3; ++axis) {
          t[i][axis] = vertices_[axis][corners[i]];
          const auto p = static_cast<float>(t[i][axis]);  // exact, because it was a float
          node.low[axis][k] = std::min(node.low[axis][k], p);
          node.high[axis][k] = std::max(node.high[axis][k], p);
        }
      }
      const Vec3d across = (t[1] - t[0]).cross(t[2] - t[0]);
      const double longest2 =
          std::max({(t[1] - t[0]).squaredNorm(), (t[2] - t[1]).squaredNorm(), (t[0] - t[2]).squaredNorm()});
      if (!(across.norm() > kThin * longest2)) continue;
      const Vec3d normal = across.normalized();
      for (int axis = 0; axis < 3; ++axis) node.normal[axis][k] = static_cast<float>(normal[axis]);
      node.offset[k] = static_cast<float>(normal.dot(t[0]));
    } else {
      node.child[k] = build(order, from, std::min(last, from + part), height - 1, triangles);
      const Node& below = nodes_[node.child[k]];
      for (int axis = 0; axis < 3; ++axis) {
        node.low[axis][k] = below.whole_low[axis];
        node.high[axis][k] = below.whole_high[axis];
      }
    }
  }
  for (int axis = 0; axis < 3; ++axis) {
    for (unsigned k = 0; k < node.count; ++k) {
      node.whole_low[axis] = std::min(node.whole_low[axis], node.low[axis][k]);
      node.whole_high[axis] = std::max(node.whole_high[axis], node.high[axis][k]);
    }
    node.size = std::max(node.size, node.whole_high[axis] - node.whole_low[axis]);
  }
  nodes_.push_back(node);
  return static_cast<std::uint32_t>(nodes_.size() - 1);
}

/// The state of one query.
struct ProbeWalk {
  using PlacedNode = PlacedProbe::Node;
  using Node = MeshProbe::Node;

  const AbTree& tree;
  PlacedProbe& probe;
  MeshContact* out;  // output of `find_contacts`; null for `find_near_pairs`
  NearPairs* near;   // output of `find_near_pairs`; null for `find_contacts`
  std::uint32_t capacity;
  std::uint32_t max_work;
  float margin;

  const MeshProbe::Node* nodes = probe.probe_.nodes_.data();
  PlacedNode* placed = probe.nodes_.data();
  PlacedProbe::Entry* stack = probe.stack_.data();
  std::uint32_t pose = probe.pose_;
  int depth = 0;
  std::uint32_t pairs = 0;  // number of pairs in probe.pairs_ that are not tested yet
  std::array<FaceId, TrianglePairs::kWidth> faces{};
  std::array<bool, TrianglePairs::kWidth> are_finest{};
  std::array<std::uint32_t, TrianglePairs::kWidth> triangles{};
  float rotation[3][3]{}, translation[3]{};         // from the probe's frame to the object's frame, with the scale
  float inverse[3][3]{}, inverse_translation[3]{};  // from the object's frame to the probe's frame
  float scale = 1;
  float reach = 0;                      // upper bound of the absolute coordinates of the placed probe
  float slack = 0, slack_in_probe = 0;  // rounding errors plus margin, in the unit of the object and of the probe
  MeshQueryResult result{};

  void prepare() noexcept {
    scale = static_cast<float>(probe.scale_);
    const Vec3d origin = -(probe.rotation_.transpose() * probe.translation_) / probe.scale_;
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) {
        rotation[i][j] = static_cast<float>(probe.scale_ * probe.rotation_(i, j));
        inverse[j][i] = static_cast<float>(probe.rotation_(i, j) / probe.scale_);
      }
      translation[i] = static_cast<float>(probe.translation_[i]);
      inverse_translation[i] = static_cast<float>(origin[i]);
    }
    reach = static_cast<float>((probe.translation_.cwiseAbs().maxCoeff() + probe.scale_ * probe.probe_.radius_) *
                               (1 + 1e-6));
    slack = kSlack * reach + margin;
    slack_in_probe = slack / scale;
  }

  void push(NodeIndex object_node, std::uint32_t probe_node, float size) noexcept {
    stack[depth++] = {object_node, probe_node, size};
  }

  /// Counts a pair of nodes as work. False if the work limit is reached.
  [[nodiscard]] bool count_pair() noexcept {
    if (result.work < max_work) {
      ++result.work;
      return true;
    }
    result.complete = false;
    return false;
  }

  void load_corners(const MeshProbe::Node& node, PlacedNode& here) const noexcept {
    for (unsigned k = 0; k < node.count; ++k) {
      const std::array<std::uint32_t, 3>& corners = probe.probe_.corners_[node.child[k]];
      for (int i = 0; i < 3; ++i)
        for (int axis = 0; axis < 3; ++axis) here.corner[i][axis][k] = probe.rounded_[axis][corners[i]];
    }
  }

  void add(const TreeNode& leaf, unsigned lane, std::uint32_t triangle) noexcept {
    if (near != nullptr) return add_near(leaf, lane, triangle);
    TrianglePairs& batch = probe.pairs_;
    const std::array<std::uint32_t, 3>& corners = probe.probe_.corners_[triangle];
    for (int i = 0; i < 3; ++i)
      for (int axis = 0; axis < 3; ++axis) {
        batch.object[i][axis][pairs] = leaf.lanes[3 * i + axis][lane];
        batch.probe[i][axis][pairs] = probe.vertices_[axis][corners[i]];
      }
    faces[pairs] = leaf.face(lane);
    are_finest[pairs] = leaf.is_finest(lane);
    triangles[pairs] = triangle;
    if (++pairs == TrianglePairs::kWidth) flush();
  }

  void add_near(const TreeNode& leaf, unsigned lane, std::uint32_t triangle) noexcept {
    const std::uint32_t at = result.contacts++;
    ++result.work;
    if (at >= capacity) {
      max_work = 0;
      return;
    }
    NearPairs& pairs_here = near[at / NearPairs::kWidth];
    const unsigned to = at % NearPairs::kWidth;
    for (int i = 0; i < 3; ++i)
      for (int axis = 0; axis < 3; ++axis) pairs_here.corners.corner[i][axis][to] = leaf.lanes[3 * i + axis][lane];
    pairs_here.face[to] = leaf.face(lane);
    pairs_here.triangle[to] = triangle;
  }

  void flush() noexcept {
    result.work += pairs;
    const PairContacts& found = probe.found_;
    for (unsigned hit = intersect(probe.pairs_, pairs, probe.found_, probe.simd_); hit != 0; hit &= hit - 1) {
      const auto lane = static_cast<unsigned>(std::countr_zero(hit));
      const std::uint32_t at = result.contacts++;
      if (at >= capacity) continue;
      out[at] = {faces[lane],
                 probe.probe_.number_[triangles[lane]],
                 are_finest[lane],
                 {found.point[0][lane], found.point[1][lane], found.point[2][lane]},
                 {found.normal[0][lane], found.normal[1][lane], found.normal[2][lane]},
                 found.depth[lane]};
    }
    pairs = 0;
  }
};

namespace {

/// Arguments of `place`, which transforms `count` points. `count` is a multiple of 8. Coordinates are by axis.
struct Placing {
  std::size_t count;
  double rotation[3][3], translation[3];
  const double* from[3];
  double* to[3];
  float* rounded[3];
};

using PlacedNode = ProbeWalk::PlacedNode;
using ProbeNode = ProbeWalk::Node;

inline unsigned highest_bit(unsigned bits) noexcept { return static_cast<unsigned>(std::bit_width(bits)) - 1; }

// There is no variant for AVX-512, because it is not faster than AVX2: the vectors have eight floats, and comparisons
// with mask registers take longer.
namespace base {
constexpr int kDoubles = 2;
#include "spm/mesh_probe_kernel.inc"
}  // namespace base
#ifdef TACTUS_HAS_TARGETS
TACTUS_TARGET_AVX2
namespace avx2 {
constexpr int kDoubles = 4;
#include "spm/mesh_probe_kernel.inc"  // NOLINT(readability-duplicate-include): for each instruction set
}  // namespace avx2
TACTUS_TARGET_END
#endif

}  // namespace

std::vector<std::array<float, 3>> MeshProbe::original_vertices() const {
  std::vector<std::array<float, 3>> vertices(vertex_count_);
  for (std::size_t v = 0; v < vertex_count_; ++v)
    for (std::size_t axis = 0; axis < 3; ++axis) vertices[v][axis] = static_cast<float>(vertices_[axis][v]);
  return vertices;
}

std::vector<std::array<std::uint32_t, 3>> MeshProbe::original_triangles() const {
  std::vector<std::array<std::uint32_t, 3>> given(corners_.size());
  for (std::size_t t = 0; t < corners_.size(); ++t) given[number_[t]] = corners_[t];
  return given;
}

PlacedProbe::PlacedProbe(const MeshProbe& probe, Simd simd)
    : probe_{probe},
      simd_{simd},
      vertices_(probe.vertices_),
      nodes_(probe.nodes_.size()),
      tree_number_(probe.triangles()),
      stack_(kStack) {
  for (std::vector<float>& rounded : rounded_) rounded.resize(vertices_[0].size());
  for (std::uint32_t t = 0; t < probe.triangles(); ++t) tree_number_[probe.number_[t]] = t;
  set_pose(Eigen::Isometry3d::Identity());
}

void PlacedProbe::begin_pose() noexcept {
  if (++pose_ != 0) return;
  for (Node& node : nodes_) node.pose = 0;  // the number has wrapped, so old numbers must not look current
  ++pose_;
}

void PlacedProbe::set_pose(const Eigen::Isometry3d& pose, double scale) noexcept {
  begin_pose();
  scale_ = scale;
  rotation_ = pose.linear();
  translation_ = pose.translation();
  Placing placing{probe_.vertices_[0].size(), {}, {}, {}, {}, {}};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) placing.rotation[i][j] = scale * rotation_(i, j);
    placing.translation[i] = translation_[i];
    placing.from[i] = probe_.vertices_[i].data();
    placing.to[i] = vertices_[i].data();
    placing.rounded[i] = rounded_[i].data();
  }
#ifdef TACTUS_HAS_TARGETS
  if (simd_ != Simd::kBase) return avx2::place(placing);
#endif
  base::place(placing);
}

Triangle3d PlacedProbe::triangle(std::uint32_t number) const noexcept {
  Triangle3d placed;
  for (int i = 0; i < 3; ++i) {
    const std::uint32_t v = probe_.corners_[tree_number_[number]][i];
    placed[i] = {vertices_[0][v], vertices_[1][v], vertices_[2][v]};
  }
  return placed;
}

MeshQueryResult PlacedProbe::find_contacts(const AbTree& tree, MeshContact* out, std::uint32_t capacity,
                                           std::uint32_t max_work) noexcept {
  return walk(tree, out, nullptr, capacity, max_work, 0);
}

MeshQueryResult PlacedProbe::find_near_pairs(const AbTree& tree, double margin, NearPairs* out, std::uint32_t capacity,
                                             std::uint32_t max_work) noexcept {
  return walk(tree, nullptr, out, capacity, max_work, static_cast<float>(margin * (1 + 1e-6)));
}

MeshQueryResult PlacedProbe::walk(const AbTree& tree, MeshContact* out, NearPairs* near, std::uint32_t capacity,
                                  std::uint32_t max_work, float margin) noexcept {
  if (tree.root() == kNone) return {};
  if (margin != margin_) begin_pose();  // the placed boxes contain the margin of another query
  margin_ = margin;
  ProbeWalk walk{tree, *this, out, near, capacity, max_work, margin};
  walk.prepare();
  walk.push(tree.root(), probe_.root_, kInfinity);
#ifdef TACTUS_HAS_TARGETS
  if (simd_ != Simd::kBase)
    avx2::walk(walk);
  else
#endif
    base::walk(walk);
  if (walk.pairs > 0) walk.flush();
  return walk.result;
}

}  // namespace tactus::spm
