/// Active bounding tree: an 8-wide tree over the finest mesh, of which only the nodes above shown faces exist.
///
/// Leaf id = face id, so the topology needs no storage: the node with id i at level l covers the faces
/// [i * 8^l, (i + 1) * 8^l), and its parent is (l + 1, i >> 3). A node is *active* if a face below it is shown; an
/// absent child is a zero bit and costs a query nothing. A face that appears, changes or disappears marks its node as
/// *deformed*. `refit` recomputes the boxes of deformed nodes, the lowest level first, and marks the parent of each box
/// that changed. With k changed faces, refit touches at most the sum over all levels of min(k, nodes of that level);
/// it asserts this bound.
///
/// All trees of an HRTC share one NodePool. Model frame, file units. Boxes are exact: float boxes of float corners.
/// Realtime. One thread at a time.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 4 (active, deformed, index list, lemma 1). We differ: 8 children
/// instead of 2, an implicit topology instead of a transmitted one, and marks stop where boxes do not change.
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

/// At level 1 a node contains the triangles of its faces, above level 1 the boxes of its children, so a query reads
/// four or five cache lines for eight neighbours. Lanes without a child are NaN (see spm/lanes.hpp).
struct alignas(64) TreeNode {
  static constexpr int kWidth = lanes::kLanes;
  std::array<lanes::Floats, lanes::kTriangleRows> lanes;
  NodeIndex parent;  ///< kNone at the root
  std::uint32_t id;  ///< within its level
  NodeIndex next_marked;
  std::uint8_t level;
  std::uint8_t mask;   ///< children that exist
  std::uint8_t dirty;  ///< children that have changed; not 0: this node is deformed
  std::uint8_t last;   ///< at level 1: faces in their finest version
  std::uint64_t kept;  ///< at level 1: AbTree::keeping_number_ when its previous version was stored
  alignas(64) std::array<std::uint32_t, kWidth> child;  ///< NodeIndex, or RowIndex at level 1

  [[nodiscard]] NodeIndex node(unsigned lane) const noexcept { return NodeIndex{child[lane]}; }
  [[nodiscard]] RowIndex row(unsigned lane) const noexcept { return RowIndex{child[lane]}; }
  /// The face of a lane at level 1.
  [[nodiscard]] FaceId face(unsigned lane) const noexcept { return FaceId{id * kWidth + lane}; }

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

/// The nodes of all trees, the table from (object, level, id) to the node, and the memory for previous versions of leaf
/// nodes (AbTree::keep).
class NodePool {
 public:
  explicit NodePool(std::uint32_t nodes);
  [[nodiscard]] std::uint32_t free() const noexcept { return free_.count(); }
  [[nodiscard]] std::uint32_t used() const noexcept { return free_.size() - free_.count(); }
  [[nodiscard]] const TreeNode& operator[](NodeIndex node) const noexcept { return nodes_[node]; }

 private:
  friend class AbTree;
  [[nodiscard]] static std::uint64_t key(ObjectIndex object, std::uint32_t level, std::uint32_t id) noexcept {
    return std::uint64_t{index(object)} << 29 | std::uint64_t{level} << 25 | id;
  }
  IdVector<NodeIndex, TreeNode> nodes_;
  FreeSet free_;
  FlatIndex index_;
  std::vector<TreeNode> kept_;
  std::vector<std::uint32_t> kept_next_;  // by index in kept_: the next of the same tree, or the next free one
  std::uint32_t kept_free_ = 0;           // the first free one
  std::uint32_t kept_free_count_ = kKeptNodes;
  std::uint64_t versions_ = 0;  // of all trees' meshes
};

/// First contact of a moving sphere.
struct SweepContact {
  FaceId face{};
  double time = 1;  ///< in [0, 1] of the motion
  Vec3d point, normal;
};

struct NearestFace {
  FaceId face{};
  Vec3d point;
  double squared_distance = 0;
  RowIndex row{};
};

/// A sphere in which a refit looks for changes of the mesh.
struct ChangeDetector {
  Vec3d centre;
  double radius = 0;
  bool met = false;  ///< a changed node intersects or intersected the sphere, or the changes surround it
  /// Squared distance of the centre to the nearest node with a changed face, as it was or is.
  double squared_distance = std::numeric_limits<double>::infinity();
};

/// The mesh for a sweep.
enum class Version : std::uint8_t {
  kNow,
  kKept  ///< the previous version: as it was at AbTree::keep
};

struct RefitCount {
  std::uint32_t changed = 0;  ///< faces marked since the last refit
  std::uint32_t marked = 0;   ///< nodes recomputed
  std::uint32_t bound = 0;    ///< the maximum for `changed` faces
};

class AbTree {
 public:
  /// `pool` and `nodes` must outlive the tree. `object` is part of the keys in the pool.
  AbTree(Pool& pool, NodePool& nodes, ObjectIndex object, std::uint32_t finest_faces);

  /// Drops the previous version. If `keeping`, stores leaf nodes from now on before they change, so that a sweep can
  /// use the mesh of this moment as the previous version. Realtime, O(1).
  void keep(bool keeping) noexcept;
  /// True if the previous version differs from the current mesh.
  [[nodiscard]] bool kept_differs() const noexcept { return keeping_ && changed_; }
  /// How many more leaf nodes can be stored.
  [[nodiscard]] std::uint32_t room_to_keep() const noexcept { return keeping_ ? nodes_.kept_free_count_ : kNone; }

  /// The maximum number of nodes that one more face needs.
  [[nodiscard]] std::uint32_t height() const noexcept { return height_; }
  static constexpr int kMaxHeight = 10;

  /// Shows the face in `row`; NodePool::free() must be at least height(). The boxes follow with refit().
  void insert(RowIndex row) noexcept;
  /// Hides it again.
  void remove(RowIndex row) noexcept;
  /// Moves corner `corner` of a shown face to `vertex`. `last`: the face is then in its finest version.
  void update(const FaceRow& row, std::uint32_t corner, const Vertex& vertex, bool last) noexcept {
    TACTUS_ASSERT(row.node != kNone);
    TreeNode& node = nodes_.nodes_[row.node];
    keep_node(node);
    const unsigned lane = lane_of(row.face);
    node.set_corner(lane, corner, vertex);
    node.set_last(lane, last);
    mark_child(row.node, node, lane);
  }

  /// Prefetch the memory of the calls above. For a face to show: first its table entry, and once that is loaded its
  /// node. For a shown row: its node.
  void prefetch_entry(FaceId face) const noexcept { nodes_.index_.prefetch(leaf_key(face)); }
  void prefetch_insert(FaceId face) const noexcept {
    const NodeIndex node{nodes_.index_.find(leaf_key(face))};
    if (node != kNone) prefetch(node);
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

  /// Recomputes the boxes of deformed nodes and frees empty nodes. Required before a query. Updates the `count`
  /// detectors with the changes since the last refit.
  RefitCount refit(ChangeDetector* change_detectors = nullptr, std::uint32_t count = 0) noexcept;

  /// Writes the shown triangles within `radius` of `centre` in tree order, at most `capacity`. Returns how many there
  /// are; more than `capacity`: truncated.
  [[nodiscard]] std::uint32_t touching(const Vec3d& centre, double radius, Contact* out,
                                       std::uint32_t capacity) const noexcept;

  /// The earliest contact of a sphere that moves from `from` to `to`; false if there is none. A triangle that the
  /// sphere already touches counts only if the sphere moves into it. A sweep that starts near an earlier one, on an
  /// unchanged mesh, finds its candidates in `caches`: 1 us, without `caches`: 2 to 5 us.
  [[nodiscard]] bool sweep(const Vec3d& from, const Vec3d& to, double radius, SweepContact& first,
                           Version version = Version::kNow, CandidateCaches* caches = nullptr) const noexcept;

  /// The nearest shown triangle within `within`; false if there is none. At equal distance, the smallest id wins.
  [[nodiscard]] bool nearest(const Vec3d& point, double within, NearestFace& found) const noexcept {
    return nearest(point, within, 0, found, nullptr, 0) > 0;
  }
  /// Also writes the rows of all triangles that are at most `more` further away, in tree order, at most `capacity` and
  /// kMaxNearest. Returns how many, and at least 1 if there is a nearest triangle.
  static constexpr std::uint32_t kMaxNearest = 96;
  [[nodiscard]] std::uint32_t nearest(const Vec3d& point, double within, double more, NearestFace& found,
                                      RowIndex* rows, std::uint32_t capacity,
                                      const CandidateCaches* caches = nullptr) const noexcept;

  [[nodiscard]] const FaceRow& row(RowIndex row) const noexcept { return pool_.faces[row]; }
  /// x y z of the three corners; the face must be shown.
  [[nodiscard]] std::array<float, 9> corners(RowIndex row) const noexcept;
  /// The corners of a face that a query has found since the last change.
  [[nodiscard]] std::array<float, 9> corners(const Contact& contact) const noexcept;
  /// Copies the nodes of level 1 with ids from `from` in ascending order, at most `capacity`. Returns how many; fewer
  /// than `capacity` at the end. O(copied x height).
  [[nodiscard]] std::uint32_t copy_leaves(std::uint32_t from, TreeNode* out, std::uint32_t capacity) const noexcept;
  /// For traversals in other classes. The root is kNone if no face is shown.
  [[nodiscard]] NodeIndex root() const noexcept { return root_; }
  [[nodiscard]] const TreeNode& node(NodeIndex node) const noexcept { return nodes_[node]; }

  /// Checks nodes, masks, boxes and faces. O(nodes), allocates: tests.
  [[nodiscard]] std::vector<std::string> violations() const;
  /// Shown face rows, ascending by FaceId. O(nodes), allocates.
  [[nodiscard]] std::vector<RowIndex> shown() const;

 private:
  static constexpr int kStack = 7 * kMaxHeight + 8;
  [[nodiscard]] static unsigned lane_of(FaceId face) noexcept { return index(face) & 7u; }
  [[nodiscard]] std::uint64_t leaf_key(FaceId face) const noexcept {
    return NodePool::key(object_, 1, index(face) >> 3);
  }

  /// Calls `visit(index, node, bits)` for each node of level 1 with triangles whose boxes are within `radius` of
  /// `point`, in tree order.
  template <class Visit>
  void walk_near(const Vec3d& point, double radius, Visit&& visit) const noexcept;
  /// The candidates around a sphere on the current mesh or on the previous version; searches for them if no cache has
  /// them. Null if there are too many.
  [[nodiscard]] const CandidateCache* candidate_cache(const Vec3d& centre, double radius, bool kept, double slack,
                                                      CandidateCaches& caches) const noexcept;
  [[nodiscard]] CandidateCache::Mesh mesh(bool kept) const noexcept {
    return {&nodes_, version_, kept ? keeping_number_ : 0};
  }
  void fill(CandidateCache& around, double within, bool kept) const noexcept;
  /// Calls `visit` for each leaf node of the previous version.
  template <class Visit>
  void for_each_kept(Visit&& visit) const noexcept {
    for (std::uint32_t at = kept_first_; at != kNone; at = nodes_.kept_next_[at]) visit(nodes_.kept_[at]);
  }
  /// Prefetch what queries read of a node of level 1, and of a node above.
  void prefetch_triangles(NodeIndex node) const noexcept {
    for (int row = 0; row < lanes::kTriangleRows; row += 2) spm::prefetch(&nodes_[node].lanes[row]);
  }
  void prefetch_children(NodeIndex node) const noexcept {
    for (int row = 0; row < lanes::kBoxRows; row += 2) spm::prefetch(&nodes_[node].lanes[row]);
    spm::prefetch(&nodes_[node].child);
  }
  void prefetch(NodeIndex node) const noexcept {
    prefetch_triangles(node);
    spm::prefetch(&nodes_[node].child);
  }
  /// Prefetches what refit reads and writes.
  void prefetch_boxes(NodeIndex node) const noexcept {
    for (int row = 0; row < lanes::kBoxRows; row += 2) spm::prefetch(&nodes_[node].lanes[row]);
    spm::prefetch(&nodes_[node].parent);
  }
  /// Stores a node of level 1 before its first change. There must be room.
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
  /// The node of level 1 with this id. Creates it and its ancestors if necessary, near its siblings.
  [[nodiscard]] NodeIndex make_leaf(std::uint32_t id) noexcept;
  void mark_child(NodeIndex at, TreeNode& node, unsigned child) noexcept {
    if (node.dirty == 0) {
      node.next_marked = marked_[node.level];
      marked_[node.level] = at;
      if (node.parent != kNone) prefetch_boxes(node.parent);  // refit writes this node's there
    }
    node.dirty = static_cast<std::uint8_t>(node.dirty | 1u << child);
  }

  Pool& pool_;
  NodePool& nodes_;
  ObjectIndex object_;
  std::uint32_t finest_faces_;
  std::uint32_t height_ = 1;
  NodeIndex root_ = kNone;
  std::array<NodeIndex, kMaxHeight + 1> marked_{};  // heads of the lists of deformed nodes, by level
  std::uint64_t version_;                           // of the mesh; unique in the pool, changed by each refit
  std::uint64_t keeping_number_ = 1;
  std::uint32_t kept_first_ = kNone, kept_last_ = kNone, kept_count_ = 0;  // in NodePool::kept_
  bool keeping_ = false;
  bool changed_ = false;  // a node has changed since `keep`
};

}  // namespace tactus::spm
