/// Active bounding tree: a tree over the finest mesh of which only the shown part exists.
///
/// Leaf id = face id, so the topology needs no storage: an 8-wide node at level l with id i covers the faces
/// [i * 8^l, (i + 1) * 8^l); its parent is (l + 1, i >> 3). Nodes exist where a face below is shown (*active*); an
/// absent child is a zero bit, and costs a query nothing. A face that appears, changes or goes marks its node
/// *deformed*; refit recomputes the boxes of marked nodes, lowest level first, and marks the node above where the box
/// has changed. With k changed faces at most sum over levels of min(k, nodes of that level) nodes are touched; refit
/// asserts it.
///
/// All trees of a controller share one NodePool. Model frame, file units, float boxes of float corners: exact.
/// Realtime. One thread at a time.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 4 (active, deformed, index list, lemma 1). We differ: 8 children
/// for 2, an implicit topology for one that is sent along, and marks that climb no further than boxes change.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "spm/candidate_cache.hpp"
#include "spm/contact.hpp"
#include "spm/flat_index.hpp"
#include "spm/free_set.hpp"
#include "spm/lanes.hpp"
#include "spm/model.hpp"
#include "spm/pool.hpp"
#include "spm/prefetch.hpp"
#include "spm/triangle.hpp"

namespace tactus::spm {

/// Above level 1 a node holds the boxes of its children, at level 1 the triangles themselves: what a query reads of
/// eight neighbours lies in four or five cache lines. Lanes without a child are NaN (see spm/lanes.hpp).
struct alignas(64) TreeNode {
  static constexpr int kWidth = lanes::kLanes;
  std::array<lanes::Floats, lanes::kTriangleRows> lanes;
  std::uint32_t parent;  ///< node; kNone at the root
  std::uint32_t id;
  std::uint32_t next_marked;
  std::uint8_t level;
  std::uint8_t mask;   ///< children that exist
  std::uint8_t dirty;  ///< children that have changed; not 0: this node is marked
  std::uint8_t last;   ///< at level 1: faces in their finest version
  std::uint64_t kept;  ///< at level 1: its tree's keeping in which what it was has been kept
  alignas(64) std::array<std::uint32_t, kWidth> child;  ///< node, or face row at level 1

  void set_corner(unsigned lane, std::uint32_t corner, const Vertex& vertex) noexcept {
    lanes[3 * corner][lane] = vertex.position[0];
    lanes[3 * corner + 1][lane] = vertex.position[1];
    lanes[3 * corner + 2][lane] = vertex.position[2];
  }
  void set_last(unsigned lane, bool value) noexcept {
    last = static_cast<std::uint8_t>((last & ~(1u << lane)) | unsigned{value} << lane);
  }
};
static_assert(sizeof(TreeNode) == kTreeNodeBytes);

/// The nodes of all trees, the table that finds one by (object, level, id), and the room in which trees keep what leaf
/// nodes were (AbTree::keep).
class NodePool {
 public:
  explicit NodePool(std::uint32_t nodes);
  [[nodiscard]] std::uint32_t free() const noexcept { return free_.count(); }
  [[nodiscard]] std::uint32_t used() const noexcept { return free_.size() - free_.count(); }
  [[nodiscard]] const TreeNode& operator[](std::uint32_t node) const noexcept { return nodes_[node]; }

 private:
  friend class AbTree;
  [[nodiscard]] static std::uint64_t key(std::uint32_t object, std::uint32_t level, std::uint32_t id) noexcept {
    return std::uint64_t{object} << 29 | std::uint64_t{level} << 25 | id;
  }
  std::vector<TreeNode> nodes_;
  FreeSet free_;
  FlatIndex index_;
  std::vector<TreeNode> kept_;
  std::vector<std::uint32_t> kept_next_;  // by number in kept_: of the same tree's, or of those that are free
  std::uint32_t kept_free_ = 0;           // the first
  std::uint32_t kept_free_count_ = kKeptNodes;
  std::uint64_t versions_ = 0;  // of all trees' meshes
};

/// First touch of a moving ball.
struct SweepContact {
  FaceId face{};
  double time = 1;  ///< in [0, 1] of the motion
  Vec3d point, normal;
};

struct NearestFace {
  FaceId face{};
  Vec3d point;
  double squared_distance = 0;
  std::uint32_t row = 0;  ///< face row
};

/// A ball that is to know whether the mesh in it may be another one.
struct ChangeDetector {
  Vec3d centre;
  double radius = 0;
  bool met = false;  ///< a node with a changed face was or is in it, or it is among changes all around
  /// Squared distance of the centre to the nearest node with a changed face, as it was or is.
  double squared_distance = std::numeric_limits<double>::infinity();
};

/// Which mesh a sweep meets.
enum class Version : std::uint8_t {
  kNow,
  kKept  ///< as it was when AbTree::keep began
};

struct RefitCount {
  std::uint32_t changed = 0;  ///< faces marked since the last refit
  std::uint32_t marked = 0;   ///< nodes recomputed
  std::uint32_t bound = 0;    ///< most that `changed` faces can mark
};

class AbTree {
 public:
  /// `pool` and `nodes` must outlive the tree. `object` keeps the keys of several trees apart (below kMaxObjects).
  AbTree(Pool& pool, NodePool& nodes, std::uint32_t object, std::uint32_t finest_faces);

  /// Drops what was kept, and from here on keeps what leaf nodes were before they change, or does not: then there is
  /// only the mesh as it is. So a sweep may be asked for on the mesh as it was when keeping began. Realtime, O(1).
  void keep(bool keeping) noexcept;
  /// The mesh that is kept is not that of now.
  [[nodiscard]] bool kept_differs() const noexcept { return keeping_ && changed_; }
  /// How many more nodes may change without being lost.
  [[nodiscard]] std::uint32_t room_to_keep() const noexcept { return keeping_ ? nodes_.kept_free_count_ : kNone; }

  /// Most nodes that one more face can need.
  [[nodiscard]] std::uint32_t height() const noexcept { return height_; }
  static constexpr int kMaxHeight = 10;

  /// Shows the face in `row`; NodePool::free() must be at least height(). The boxes follow with refit().
  void insert(std::uint32_t row) noexcept;
  /// Hides it again.
  void remove(std::uint32_t row) noexcept;
  /// Corner `corner` of a shown face now stands on `vertex`, and with it the face is or is not in its finest version.
  void update(const FaceRow& row, std::uint32_t corner, const Vertex& vertex, bool last) noexcept {
    TACTUS_ASSERT(row.node != kNone);
    TreeNode& node = nodes_.nodes_[row.node];
    keep_node(node);
    const unsigned lane = row.face & 7u;
    node.set_corner(lane, corner, vertex);
    node.set_last(lane, last);
    mark_child(row.node, node, lane);
  }

  /// Bring into the cache what the calls above will touch: of a face to be shown first the place in the table, then,
  /// when that has come, the node; of a shown row the node.
  void prefetch_entry(std::uint32_t face) const noexcept {
    nodes_.index_.prefetch(NodePool::key(object_, 1, face >> 3));
  }
  void prefetch_insert(std::uint32_t face) const noexcept {
    const std::uint32_t slot = nodes_.index_.find(NodePool::key(object_, 1, face >> 3));
    if (slot != kNone) prefetch(slot);
  }
  void prefetch_remove(const FaceRow& row) const noexcept {
    if (row.node != kNone) prefetch(row.node);
  }
  void prefetch_update(const FaceRow& row, std::uint32_t corner) const noexcept {
    if (row.node == kNone) return;
    const TreeNode& node = nodes_.nodes_[row.node];
    spm::prefetch(&node.lanes[3 * corner]);
    spm::prefetch(&node.lanes[3 * corner + 2]);
    spm::prefetch(&node.parent);
  }

  /// Makes all boxes right again and frees the nodes that are empty. Must come before a query. Tells the `count`
  /// `watches` of changes since the last refit.
  RefitCount refit(ChangeDetector* change_detectors = nullptr, std::uint32_t count = 0) noexcept;

  /// All shown triangles within `radius` of `centre`, in tree order, at most `capacity` of them; returns how many there
  /// are in all (more than `capacity`: truncated).
  [[nodiscard]] std::uint32_t touching(const Vec3d& centre, double radius, Contact* out,
                                       std::uint32_t capacity) const noexcept;

  /// Earliest touch of a ball moving from `from` to `to`; false when there is none. Triangles that it touches already
  /// count only while it moves into them. With `caches` one that starts where one before did, or within a hair of it,
  /// on a mesh that has not changed, finds there what is around it: some 1 us, 2 to 5 without.
  [[nodiscard]] bool sweep(const Vec3d& from, const Vec3d& to, double radius, SweepContact& first,
                           Version version = Version::kNow, CandidateCaches* caches = nullptr) const noexcept;

  /// The nearest shown triangle within `within`; false when there is none. Of equally near ones, that of the smallest
  /// id.
  [[nodiscard]] bool nearest(const Vec3d& point, double within, NearestFace& found) const noexcept {
    return nearest(point, within, 0, found, nullptr, 0) > 0;
  }
  /// The same with the rows of all that are at most `more` further away, in tree order, at most `capacity` and
  /// kMaxNearest; returns how many, at least 1 when there is one.
  static constexpr std::uint32_t kMaxNearest = 96;
  [[nodiscard]] std::uint32_t nearest(const Vec3d& point, double within, double more, NearestFace& found,
                                      std::uint32_t* rows, std::uint32_t capacity,
                                      const CandidateCaches* caches = nullptr) const noexcept;

  [[nodiscard]] const FaceRow& row(std::uint32_t number) const noexcept { return pool_.faces[number]; }
  /// x y z of its three corners; it must be shown.
  [[nodiscard]] std::array<float, 9> corners(std::uint32_t row) const noexcept;
  /// Those of a face that a query since the last change has met.
  [[nodiscard]] std::array<float, 9> corners(const Contact& contact) const noexcept;
  /// Copies nodes of level 1 with ids from `from` on, ascending, at most `capacity`, and returns how many: fewer than
  /// that when no more are left. O(copied x height).
  [[nodiscard]] std::uint32_t copy_leaves(std::uint32_t from, TreeNode* out, std::uint32_t capacity) const noexcept;
  /// For traversals that live elsewhere: the root, kNone when nothing is shown, and any node.
  [[nodiscard]] std::uint32_t root() const noexcept { return root_; }
  [[nodiscard]] const TreeNode& node(std::uint32_t number) const noexcept { return nodes_[number]; }

  /// What is broken: nodes, masks, boxes, unknown faces. O(nodes), allocates: tests.
  [[nodiscard]] std::vector<std::string> violations() const;
  /// Shown face rows, ascending by FaceId. O(nodes), allocates.
  [[nodiscard]] std::vector<std::uint32_t> shown() const;

 private:
  static constexpr int kStack = 7 * kMaxHeight + 8;

  /// Calls `visit(node's number, node, bits)` for each node of level 1 with triangles whose boxes come within `radius`
  /// of `point`, in tree order.
  template <class Visit>
  void walk_near(const Vec3d& point, double radius, Visit&& visit) const noexcept;
  /// Where a sweep on the mesh of now, or on the kept one, finds what is around a ball; null where that is too much. Of
  /// what nothing knows yet it is sought.
  [[nodiscard]] const CandidateCache* candidate_cache(const Vec3d& centre, double radius, bool kept, double slack,
                                                      CandidateCaches& caches) const noexcept;
  [[nodiscard]] CandidateCache::Mesh mesh(bool kept) const noexcept {
    return {&nodes_, version_, kept ? keeping_number_ : 0};
  }
  void fill(CandidateCache& around, double within, bool kept) const noexcept;
  /// Calls `visit` for each node that is kept.
  template <class Visit>
  void for_each_kept(Visit&& visit) const noexcept {
    for (std::uint32_t at = kept_first_; at != kNone; at = nodes_.kept_next_[at]) visit(nodes_.kept_[at]);
  }
  /// What queries read of a node of level 1, and of one above.
  void prefetch_triangles(std::uint32_t node) const noexcept {
    for (int row = 0; row < lanes::kTriangleRows; row += 2) spm::prefetch(&nodes_[node].lanes[row]);
  }
  void prefetch_children(std::uint32_t node) const noexcept {
    for (int row = 0; row < lanes::kBoxRows; row += 2) spm::prefetch(&nodes_[node].lanes[row]);
    spm::prefetch(&nodes_[node].child);
  }
  void prefetch(std::uint32_t node) const noexcept {
    prefetch_triangles(node);
    spm::prefetch(&nodes_[node].child);
  }
  /// What refit does.
  void prefetch_boxes(std::uint32_t node) const noexcept {
    for (int row = 0; row < lanes::kBoxRows; row += 2) spm::prefetch(&nodes_[node].lanes[row]);
    spm::prefetch(&nodes_[node].parent);
  }
  /// What a node of level 1 is, before it first changes. There must be room.
  void keep_node(TreeNode& node) noexcept {
    if (!keeping_ || node.kept == keeping_number_) return;
    TACTUS_ASSERT(nodes_.kept_free_count_ > 0);
    node.kept = keeping_number_;
    changed_ = true;
    const std::uint32_t at = nodes_.kept_free_;
    nodes_.kept_free_ = nodes_.kept_next_[at];
    --nodes_.kept_free_count_;
    nodes_.kept_[at] = node;
    nodes_.kept_next_[at] = kNone;
    (kept_last_ != kNone ? nodes_.kept_next_[kept_last_] : kept_first_) = at;
    kept_last_ = at;
    ++kept_count_;
  }
  /// The node of level 1 with this id, made with those above it where they are missing, near its siblings.
  [[nodiscard]] std::uint32_t make_leaf(std::uint32_t id) noexcept;
  void mark_child(std::uint32_t slot, TreeNode& node, unsigned child) noexcept {
    if (node.dirty == 0) {
      node.next_marked = marked_[node.level];
      marked_[node.level] = slot;
      if (node.parent != kNone) prefetch_boxes(node.parent);  // refit writes this node's there
    }
    node.dirty = static_cast<std::uint8_t>(node.dirty | 1u << child);
  }

  Pool& pool_;
  NodePool& nodes_;
  std::uint32_t object_;
  std::uint32_t finest_faces_;
  std::uint32_t height_ = 1;
  std::uint32_t root_ = kNone;
  std::array<std::uint32_t, kMaxHeight + 1> marked_{};  // heads of the lists of marked nodes, by level
  std::uint64_t version_;                               // of the mesh, among all of the pool; each refit's is another
  std::uint64_t keeping_number_ = 1;
  std::uint32_t kept_first_ = kNone, kept_last_ = kNone, kept_count_ = 0;  // in NodePool::kept_
  bool keeping_ = false;
  bool changed_ = false;  // something, since keeping began
};

}  // namespace tactus::spm
