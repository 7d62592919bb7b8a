/// The active bounding tree (AB-tree): an 8-wide tree over the finest mesh, of which only the nodes above shown faces
/// exist.
///
/// FaceIds determine the topology, so it needs no storage: the node with id i at level l covers the faces
/// [i * 8^l, (i + 1) * 8^l), and its parent has id i >> 3 at level l + 1. A node is *active* if a face below it is
/// shown. A child that does not exist is a zero bit of the mask and costs a query nothing. When a face appears, changes
/// or disappears, its node is marked as *deformed*. `refit` recomputes the boxes of deformed nodes, the lowest level
/// first. If the box of a node changed, `refit` also marks the parent. With k changed faces, `refit` recomputes at most
/// the sum over all levels of min(k, nodes of that level). It asserts this bound.
///
/// All trees of an HRTC share one NodePool. Model frame, file units. Boxes are exact, because boxes and corners are
/// floats. Realtime. One thread at a time.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 4 (active, deformed, index list, lemma 1). We differ: a node has 8
/// children instead of 2, the topology is implicit instead of transmitted, and marking stops at a box that does not
/// change.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "spm/candidate_cache.hpp"
#include "spm/compact_index.hpp"
#include "spm/contact.hpp"
#include "spm/free_set.hpp"
#include "spm/lanes.hpp"
#include "spm/model.hpp"
#include "spm/pool.hpp"
#include "spm/prefetch.hpp"
#include "spm/triangle.hpp"

namespace tactus::spm {

/// A node of level 1 contains the triangles of its faces; a higher node contains the boxes and the indices of its
/// children. A query therefore reads four or five cache lines for eight triangles or boxes. Lanes without a child are
/// NaN (see spm/lanes.hpp).
struct alignas(64) TreeNode {
  static constexpr int kWidth = lanes::kLanes;
  std::array<lanes::Floats, lanes::kTriangleRows> lanes;
  NodeIndex parent;       ///< kNone at the root
  std::uint32_t id;       ///< number of the node within its level
  NodeIndex next_marked;  ///< next node in the list of deformed nodes of this level
  std::uint8_t level;
  std::uint8_t mask;              ///< bits of the children that exist
  std::uint8_t dirty;             ///< bits of the children that changed; if it is not 0, this node is deformed
  std::uint8_t finest;            ///< at level 1: bits of the faces in their finest version
  std::uint64_t previous_number;  ///< at level 1: AbTree::previous_number_ when the node was last stored or created
  ObjectIndex object;             ///< the object of this tree

  /// Child of a node above level 1. Row kBoxRows contains its index.
  [[nodiscard]] NodeIndex node(unsigned lane) const noexcept {
    std::uint32_t number;
    std::memcpy(&number, &lanes[lanes::kBoxRows][lane], sizeof number);
    return NodeIndex{number};
  }
  void set_node(unsigned lane, NodeIndex child) noexcept {
    const std::uint32_t number = index(child);
    std::memcpy(&lanes[lanes::kBoxRows][lane], &number, sizeof number);
  }
  /// The face of a lane at level 1.
  [[nodiscard]] FaceId face(unsigned lane) const noexcept { return FaceId{id * kWidth + lane}; }

  void set_corner(unsigned lane, std::uint32_t corner, const Vertex& vertex) noexcept {
    lanes[3 * corner][lane] = vertex.position[0];
    lanes[3 * corner + 1][lane] = vertex.position[1];
    lanes[3 * corner + 2][lane] = vertex.position[2];
  }
  [[nodiscard]] bool is_finest(unsigned lane) const noexcept { return (finest >> lane & 1u) != 0; }
  void set_finest(unsigned lane, bool value) noexcept {
    finest = static_cast<std::uint8_t>((finest & ~(1u << lane)) | unsigned{value} << lane);
  }
};
static_assert(sizeof(TreeNode) == kTreeNodeBytes);

/// Stores the nodes of all trees, the table from (object, level, id) to the node, and the previous versions of leaf
/// nodes (AbTree::store_previous).
class NodePool {
 public:
  explicit NodePool(std::uint32_t nodes);
  [[nodiscard]] std::uint32_t free_nodes() const noexcept { return free_.count(); }
  [[nodiscard]] std::uint32_t used_nodes() const noexcept { return free_.size() - free_.count(); }
  [[nodiscard]] const TreeNode& operator[](NodeIndex node) const noexcept { return nodes_[node]; }
  [[nodiscard]] NodeIndex index_of(const TreeNode& node) const noexcept {
    return NodeIndex{static_cast<std::uint32_t>(&node - nodes_.values().data())};
  }

 private:
  friend class AbTree;
  [[nodiscard]] static std::uint64_t key(ObjectIndex object, std::uint32_t level, std::uint32_t id) noexcept {
    static_assert(kMaxFaces / TreeNode::kWidth <= 1u << 27);
    return std::uint64_t{index(object)} << 31 | std::uint64_t{level} << 27 | id;
  }
  [[nodiscard]] static std::uint64_t key(const TreeNode& node) noexcept {
    return key(node.object, node.level, node.id);
  }
  [[nodiscard]] auto key_of_node() const noexcept {
    return [this](std::uint32_t number) { return key(nodes_[NodeIndex{number}]); };
  }
  [[nodiscard]] NodeIndex find(std::uint64_t key) const noexcept { return NodeIndex{index_.find(key, key_of_node())}; }
  IdVector<NodeIndex, TreeNode> nodes_;
  FreeSet free_;
  CompactIndex index_;  // (object, level, id) -> node
  std::vector<TreeNode> previous_nodes_;
  std::vector<std::uint32_t> next_previous_;  // linked lists in previous_nodes_: one for each tree, one of free nodes
  std::uint32_t first_free_previous_ = 0;     // head of the list of free nodes
  std::uint32_t free_previous_count_ = kMaxPreviousLeaves;
  std::uint64_t newest_version_ = 0;  // last assigned AbTree::version_
};

/// The first contact of a moving sphere.
struct SweepContact {
  FaceId face{};
  double time = 1;      ///< share of the motion before the contact, in [0, 1]
  Vec3d point, normal;  ///< contact point on the face; unit vector from there to the centre of the sphere at contact
};

struct NearestFace {
  FaceId face{};
  Vec3d point;
  double squared_distance = 0;
};

/// A sphere in which a refit looks for changes of the mesh. A refit sets `is_changed` but never clears it, and only
/// decreases `squared_distance`: the caller resets both.
struct ChangeDetector {
  Vec3d centre;
  double radius = 0;
  /// True if the changed box of a leaf intersects the sphere, or the box around all changed boxes contains the sphere.
  /// The changed box of a leaf contains its boxes before and after a change.
  bool is_changed = false;
  /// Squared distance of the centre from the nearest changed box.
  double squared_distance = std::numeric_limits<double>::infinity();
};

/// The version of the mesh that a sweep searches.
enum class Version : std::uint8_t {
  kCurrent,
  kPrevious  ///< the mesh at the last call of AbTree::store_previous
};

struct RefitCount {
  std::uint32_t changed = 0;  ///< number of faces marked since the last refit
  std::uint32_t marked = 0;   ///< number of recomputed nodes
  std::uint32_t bound = 0;    ///< maximum that `marked` can reach for this number of changed faces
};

class AbTree {
 public:
  /// `pool` and `nodes` must outlive the tree. `object` is part of the keys in the pool.
  AbTree(Pool& pool, NodePool& nodes, ObjectIndex object, std::uint32_t finest_faces);

  /// Drops the previous version. If `enabled`, the current mesh becomes the previous version: from now on, the tree
  /// stores each leaf node before its first change, so that a sweep can still search this mesh. Realtime, O(1).
  void store_previous(bool enabled) noexcept;
  /// Returns true if there is a previous version and a leaf node has changed since.
  [[nodiscard]] bool previous_differs() const noexcept { return stores_previous_ && is_changed_; }
  /// The number of leaf nodes that can still be stored for the previous version; kNone if there is no previous version.
  [[nodiscard]] std::uint32_t free_previous_nodes() const noexcept {
    return stores_previous_ ? nodes_.free_previous_count_ : kNone;
  }

  /// The maximum number of nodes that one more face needs.
  [[nodiscard]] std::uint32_t height() const noexcept { return height_; }
  static constexpr int kMaxHeight = 10;

  /// Shows a face in the version with these corners. NodePool::free_nodes() must be at least height(). `refit` updates
  /// the boxes.
  void insert(RowIndex row, FaceId face, const std::array<Slot, 3>& corners, bool is_finest) noexcept;
  /// Hides the face in `row`.
  void remove(RowIndex row) noexcept;
  /// Moves corner `corner` of a shown face to `vertex`. `is_finest` states whether the face then has its finest
  /// version.
  void update(RowIndex row, std::uint32_t corner, const Vertex& vertex, bool is_finest) noexcept {
    const LeafLane at = pool_.shown_at[row];
    TACTUS_ASSERT(at.is_shown());
    TreeNode& node = nodes_.nodes_[at.leaf()];
    store_node(node);
    node.set_corner(at.lane(), corner, vertex);
    node.set_finest(at.lane(), is_finest);
    mark_child(at.leaf(), node, at.lane());
  }

  /// The prefetch functions load the memory that the functions above need. Before `insert`, call `prefetch_entry` and,
  /// once the table entry is in the CPU cache, `prefetch_insert`.
  void prefetch_entry(FaceId face) const noexcept { nodes_.index_.prefetch(leaf_key(face)); }
  void prefetch_insert(FaceId face) const noexcept {
    const NodeIndex node{nodes_.index_.guess(leaf_key(face))};
    if (node != kNone) prefetch_triangles(node);
  }
  void prefetch_remove(LeafLane at) const noexcept {
    if (at.is_shown()) prefetch_triangles(at.leaf());
  }
  void prefetch_update(LeafLane at, std::uint32_t corner) const noexcept {
    if (!at.is_shown()) return;
    const TreeNode& node = nodes_.nodes_[at.leaf()];
    spm::prefetch(&node.lanes[3 * corner]);
    spm::prefetch(&node.lanes[3 * corner + 2]);
    spm::prefetch(&node.parent);
  }

  /// Recomputes the boxes of deformed nodes and frees empty nodes. Must be called after changes and before a query.
  /// Updates the `count` detectors with the changes since the last refit.
  RefitCount refit(ChangeDetector* change_detectors = nullptr, std::uint32_t count = 0) noexcept;

  /// Writes a contact for each shown triangle within `radius` of `centre`, in tree order, at most `capacity`. Returns
  /// the number of these triangles; if it exceeds `capacity`, the contacts are truncated.
  [[nodiscard]] std::uint32_t find_contacts(const Vec3d& centre, double radius, Contact* out,
                                            std::uint32_t capacity) const noexcept;

  /// Finds the earliest contact of a sphere that moves from `from` to `to`; false if there is none. A triangle that the
  /// sphere already touches counts only if the sphere moves into it. If an earlier sweep on the same mesh started
  /// nearby, this sweep takes its candidates from `caches` and needs 1 us. Without `caches` it needs 2 to 5 us.
  [[nodiscard]] bool sweep(const Vec3d& from, const Vec3d& to, double radius, SweepContact& first,
                           Version version = Version::kCurrent, CandidateCaches* caches = nullptr) const noexcept;

  /// Finds the nearest shown triangle within `max_distance`; false if there is none. At equal distance, finds the
  /// smallest FaceId.
  [[nodiscard]] bool nearest(const Vec3d& point, double max_distance, NearestFace& found) const noexcept {
    return nearest(point, max_distance, 0, found, nullptr, 0) > 0;
  }
  static constexpr std::uint32_t kMaxNearest = 96;
  /// Also writes leaf and lane of all triangles whose distance exceeds that of the nearest one by at most `margin`, in
  /// the order of FaceIds. Writes at most min(`capacity`, kMaxNearest). Returns their number, at least 1 if there is
  /// a nearest triangle.
  [[nodiscard]] std::uint32_t nearest(const Vec3d& point, double max_distance, double margin, NearestFace& found,
                                      LeafLane* leaf_lanes, std::uint32_t capacity,
                                      const CandidateCaches* caches = nullptr) const noexcept;

  /// The face that is shown in a lane of a leaf.
  [[nodiscard]] FaceId face(LeafLane at) const noexcept { return nodes_[at.leaf()].face(at.lane()); }
  /// Whether it is shown in its finest version.
  [[nodiscard]] bool is_finest(LeafLane at) const noexcept { return nodes_[at.leaf()].is_finest(at.lane()); }
  /// The coordinates x y z of its three corners.
  [[nodiscard]] std::array<float, 9> corners(LeafLane at) const noexcept;
  /// The corners of the face of a contact that a query returned after the last change of the tree.
  [[nodiscard]] std::array<float, 9> corners(const Contact& contact) const noexcept;
  /// Copies the nodes of level 1 whose ids are at least `from`, in ascending order, at most `capacity`. Returns their
  /// number; it is below `capacity` only if no node follows. O(copied x height).
  [[nodiscard]] std::uint32_t copy_leaves(std::uint32_t from, TreeNode* out, std::uint32_t capacity) const noexcept;
  /// Root and nodes, for traversals in other classes. The root is kNone if no face is shown.
  [[nodiscard]] NodeIndex root() const noexcept { return root_; }
  [[nodiscard]] const TreeNode& node(NodeIndex node) const noexcept { return nodes_[node]; }

  /// Checks nodes, masks and boxes. O(nodes), allocates: tests.
  [[nodiscard]] std::vector<std::string> violations() const;
  /// Returns leaf and lane of all shown faces, ascending by FaceId. O(nodes), allocates.
  [[nodiscard]] std::vector<LeafLane> shown() const;

 private:
  static constexpr int kStack = 7 * kMaxHeight + 8;
  [[nodiscard]] static unsigned lane_of(FaceId face) noexcept { return index(face) & 7u; }
  [[nodiscard]] std::uint64_t leaf_key(FaceId face) const noexcept {
    return NodePool::key(object_, 1, index(face) >> 3);
  }

  /// Calls `visit(index, node, bits)` for each node of level 1 with triangles whose boxes are within `radius` of
  /// `point`, in tree order. `bits` marks these triangles.
  template <class Visit>
  void for_each_near_leaf(const Vec3d& point, double radius, Visit&& visit) const noexcept;
  /// Returns a cache with the leaves around a sphere, on the current mesh or on the previous version. If no cache
  /// contains them, fills one. Null if there are more leaves than fit. `slack`: maximum rounding error of a distance.
  [[nodiscard]] const CandidateCache* find_or_fill(const Vec3d& centre, double radius, bool previous, double slack,
                                                   CandidateCaches& caches) const noexcept;
  [[nodiscard]] CandidateCache::Mesh mesh(bool previous) const noexcept {
    return {&nodes_, version_, previous ? previous_number_ : 0};
  }
  void fill(CandidateCache& cache, double radius, bool previous) const noexcept;
  /// Calls `visit` for each leaf node of the previous version.
  template <class Visit>
  void for_each_previous(Visit&& visit) const noexcept {
    for (std::uint32_t at = first_previous_; at != kNone; at = nodes_.next_previous_[at])
      visit(nodes_.previous_nodes_[at]);
  }
  /// Prefetches all of a leaf.
  void prefetch_triangles(NodeIndex node) const noexcept {
    for (int row = 0; row < lanes::kTriangleRows; row += 2) spm::prefetch(&nodes_[node].lanes[row]);
  }
  /// Prefetches the boxes and indices of the children of a higher node.
  void prefetch_children(NodeIndex node) const noexcept {
    for (int row = 0; row <= lanes::kBoxRows; row += 2) spm::prefetch(&nodes_[node].lanes[row]);
  }
  /// Prefetches the boxes of a node and its parent index, for `refit`.
  void prefetch_boxes(NodeIndex node) const noexcept {
    for (int row = 0; row < lanes::kBoxRows; row += 2) spm::prefetch(&nodes_[node].lanes[row]);
    spm::prefetch(&nodes_[node].parent);
  }
  /// Stores a node of level 1 before its first change. If it is not stored yet, free_previous_nodes() must not be 0.
  void store_node(TreeNode& node) noexcept {
    if (!stores_previous_ || node.previous_number == previous_number_) return;
    TACTUS_ASSERT(nodes_.free_previous_count_ > 0);
    node.previous_number = previous_number_;
    is_changed_ = true;
    const std::uint32_t at = nodes_.first_free_previous_;
    nodes_.first_free_previous_ = nodes_.next_previous_[at];
    --nodes_.free_previous_count_;
    nodes_.previous_nodes_[at] = node;
    nodes_.next_previous_[at] = kNone;
    (last_previous_ != kNone ? nodes_.next_previous_[last_previous_] : first_previous_) = at;
    last_previous_ = at;
    ++previous_count_;
  }
  /// Returns the node of level 1 with this id. Creates it and its ancestors if necessary, near its siblings in memory.
  [[nodiscard]] NodeIndex make_leaf(std::uint32_t id) noexcept;
  void mark_child(NodeIndex at, TreeNode& node, unsigned child) noexcept {
    if (node.dirty == 0) {
      node.next_marked = marked_[node.level];
      marked_[node.level] = at;
      if (node.parent != kNone) prefetch_boxes(node.parent);  // refit writes the box of this node into its parent
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
  std::uint64_t version_;                           // number of the mesh: unique in the pool, new after a refit
  std::uint64_t previous_number_ = 1;
  std::uint32_t first_previous_ = kNone, last_previous_ = kNone, previous_count_ = 0;  // in NodePool::previous_nodes_
  bool stores_previous_ = false;
  bool is_changed_ = false;  // a node has changed since `store_previous`
};

}  // namespace tactus::spm
