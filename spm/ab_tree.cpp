#include "spm/ab_tree.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

namespace tactus::spm {
namespace {

constexpr float kEmptyLane = std::numeric_limits<float>::quiet_NaN();

constexpr std::array<lanes::Floats, lanes::kTriangleRows> no_lanes() noexcept {
  std::array<lanes::Floats, lanes::kTriangleRows> rows{};
  for (lanes::Floats& row : rows)
    for (float& lane : row) lane = kEmptyLane;
  return rows;
}
constexpr auto kNoLanes = no_lanes();

void clear_lane(TreeNode& node, unsigned lane) noexcept {
  for (lanes::Floats& row : node.lanes) row[lane] = kEmptyLane;
}

lanes::Bounds bounds_of(const TreeNode& node) noexcept {
  lanes::Bounds bounds;
  if (node.level == 1)
    lanes::kBestKernels.bounds_of_triangles(node.lanes.data(), bounds);
  else
    lanes::kBestKernels.bounds_of_boxes(node.lanes.data(), bounds);
  return bounds;
}

/// Sets the box of a child. False if the child already had this box.
bool set_box(TreeNode& node, unsigned child, const lanes::Bounds& bounds) noexcept {
  bool changed = false;
  for (int axis = 0; axis < 3; ++axis) {
    changed =
        changed || !(node.lanes[axis][child] == bounds.low[axis] && node.lanes[3 + axis][child] == bounds.high[axis]);
    node.lanes[axis][child] = bounds.low[axis];
    node.lanes[3 + axis][child] = bounds.high[axis];
  }
  return changed;
}

constexpr float kFar = std::numeric_limits<float>::infinity();
constexpr lanes::Bounds kNoBounds{{kFar, kFar, kFar}, {-kFar, -kFar, -kFar}};

/// Extends `all` by the box of a child. A child without a box consists of NaNs, which compare as neither smaller nor
/// larger, so it changes nothing.
void add(lanes::Bounds& all, const TreeNode& node, unsigned child) noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    const float low = node.lanes[axis][child], high = node.lanes[3 + axis][child];
    all.low[axis] = low < all.low[axis] ? low : all.low[axis];
    all.high[axis] = high > all.high[axis] ? high : all.high[axis];
  }
}

void add(lanes::Bounds& all, const lanes::Bounds& more) noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    all.low[axis] = std::min(all.low[axis], more.low[axis]);
    all.high[axis] = std::max(all.high[axis], more.high[axis]);
  }
}

double squared_distance(const lanes::Bounds& box, const Vec3d& point) noexcept {
  double sum = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double below = box.low[axis] - point[axis], above = point[axis] - box.high[axis];
    const double outside = below > above ? below : above;
    sum += outside > 0 ? outside * outside : 0;
  }
  return sum;
}

bool contains(const lanes::Bounds& box, const ChangeDetector& sphere) noexcept {
  bool inside = true;
  for (int axis = 0; axis < 3; ++axis)
    inside = inside && box.low[axis] <= sphere.centre[axis] - sphere.radius &&
             box.high[axis] >= sphere.centre[axis] + sphere.radius;
  return inside;
}

inline unsigned highest_bit(unsigned bits) noexcept { return static_cast<unsigned>(std::bit_width(bits)) - 1; }

}  // namespace

NodePool::NodePool(std::uint32_t nodes)
    : nodes_(nodes),
      free_{nodes},
      index_{nodes, nodes},
      previous_nodes_(kMaxPreviousLeaves),
      next_previous_(kMaxPreviousLeaves) {
  for (std::uint32_t i = 0; i < kMaxPreviousLeaves; ++i) next_previous_[i] = i + 1 < kMaxPreviousLeaves ? i + 1 : kNone;
}

AbTree::AbTree(Pool& pool, NodePool& nodes, ObjectIndex object, std::uint32_t finest_faces)
    : pool_{pool}, nodes_{nodes}, object_{object}, finest_faces_{finest_faces}, version_{++nodes.newest_version_} {
  marked_.fill(kNone);
  while ((std::uint64_t{1} << 3 * height_) < finest_faces) ++height_;
}

void AbTree::store_previous(bool enabled) noexcept {
  if (first_previous_ != kNone) {
    nodes_.next_previous_[last_previous_] = nodes_.first_free_previous_;
    nodes_.first_free_previous_ = first_previous_;
    nodes_.free_previous_count_ += previous_count_;
    first_previous_ = last_previous_ = kNone;
    previous_count_ = 0;
  }
  stores_previous_ = enabled;
  is_changed_ = false;
  ++previous_number_;
}

NodeIndex AbTree::make_leaf(std::uint32_t id) noexcept {
  const auto key = [&](std::uint32_t level) { return NodePool::key(object_, level, id >> 3 * (level - 1)); };
  NodeIndex at = kNone;  // the lowest ancestor that exists
  std::uint32_t level = 1;
  for (; level <= height_; ++level) {
    at = nodes_.find(key(level));
    if (at != kNone) break;
  }
  NodeIndex near = at;
  if (at != kNone && level > 1 && nodes_[at].mask != 0) near = nodes_[at].node(std::countr_zero(nodes_[at].mask));
  while (level > 1) {
    const NodeIndex above = at;
    --level;
    TACTUS_ASSERT(nodes_.free_nodes() > 0);
    at = near = NodeIndex{nodes_.free_.allocate(near != kNone ? index(near) : 0)};
    TreeNode& node = nodes_.nodes_[at];
    node.lanes = kNoLanes;
    node.object = object_;
    node.parent = above;
    node.id = id >> 3 * (level - 1);
    node.level = static_cast<std::uint8_t>(level);
    node.mask = 0;
    node.dirty = 0;
    node.finest = 0;
    node.previous_number = previous_number_;  // the node has no previous version to store
    is_changed_ = true;
    nodes_.index_.insert(key(level), index(at));
    if (above == kNone) {
      root_ = at;
    } else {
      TreeNode& parent = nodes_.nodes_[above];
      parent.set_node(node.id & 7u, at);
      parent.mask = static_cast<std::uint8_t>(parent.mask | 1u << (node.id & 7u));
    }
  }
  return at;
}

void AbTree::insert(RowIndex row, FaceId face, const std::array<Slot, 3>& corners, bool is_finest) noexcept {
  TACTUS_ASSERT(!pool_.shown_at[row].is_shown() && index(face) < finest_faces_);
  const NodeIndex leaf = make_leaf(index(face) >> 3);
  TreeNode& node = nodes_.nodes_[leaf];
  store_node(node);
  const unsigned lane = lane_of(face);
  node.mask = static_cast<std::uint8_t>(node.mask | 1u << lane);
  pool_.shown_at[row] = LeafLane{leaf, lane};
  for (std::uint32_t corner = 0; corner < 3; ++corner) node.set_corner(lane, corner, pool_.vertices[corners[corner]]);
  node.set_finest(lane, is_finest);
  mark_child(leaf, node, lane);
}

void AbTree::remove(RowIndex row) noexcept {
  const LeafLane at = std::exchange(pool_.shown_at[row], LeafLane{});
  TACTUS_ASSERT(at.is_shown());
  TreeNode& node = nodes_.nodes_[at.leaf()];
  store_node(node);
  node.mask = static_cast<std::uint8_t>(node.mask & ~(1u << at.lane()));
  clear_lane(node, at.lane());
  mark_child(at.leaf(), node, at.lane());
}

std::uint32_t AbTree::copy_leaves(std::uint32_t from, TreeNode* out, std::uint32_t capacity) const noexcept {
  std::uint32_t copied = 0;
  std::array<NodeIndex, kStack> stack;
  int depth = 0;
  if (root_ != kNone) stack[depth++] = root_;
  while (depth > 0 && copied < capacity) {
    const TreeNode& node = nodes_[stack[--depth]];
    if (node.level == 1) {
      if (node.id >= from) out[copied++] = node;
      continue;
    }
    for (unsigned bits = node.mask; bits != 0;) {
      const unsigned child = highest_bit(bits);
      bits &= ~(1u << child);
      // End of the ids of level 1 below this child.
      const std::uint64_t end = (std::uint64_t{node.id} * TreeNode::kWidth + child + 1) << 3 * (node.level - 2);
      if (end <= from) break;
      stack[depth++] = node.node(child);
      prefetch_triangles(node.node(child));
    }
  }
  return copied;
}

namespace {
std::array<float, 9> corners_of(const TreeNode& node, unsigned lane) noexcept {
  std::array<float, 9> corners;
  for (std::size_t i = 0; i < corners.size(); ++i) corners[i] = node.lanes[i][lane];
  return corners;
}
}  // namespace

std::array<float, 9> AbTree::corners(LeafLane at) const noexcept {
  TACTUS_ASSERT(at.is_shown());
  return corners_of(nodes_[at.leaf()], at.lane());
}

std::array<float, 9> AbTree::corners(const Contact& contact) const noexcept {
  return corners_of(nodes_[contact.node()], lane_of(contact.face));
}

RefitCount AbTree::refit(ChangeDetector* change_detectors, std::uint32_t detector_count) noexcept {
  RefitCount count;
  lanes::Bounds all = kNoBounds;
  // Updates `all` and the detectors with the old and the new box of a changed leaf.
  const auto notify = [&](const TreeNode* above, unsigned lane, const lanes::Bounds& now) noexcept {
    lanes::Bounds changed = now;
    if (above != nullptr) add(changed, *above, lane);  // the box before the change
    add(all, changed);
    for (std::uint32_t i = 0; i < detector_count; ++i)
      change_detectors[i].squared_distance =
          std::min(change_detectors[i].squared_distance, squared_distance(changed, change_detectors[i].centre));
  };
  IdVector<NodeIndex, TreeNode>& nodes = nodes_.nodes_;
  for (std::uint32_t level = 1; level <= height_; ++level) {
    NodeIndex at = marked_[level];
    marked_[level] = kNone;
    while (at != kNone) {
      TreeNode& node = nodes[at];
      const NodeIndex next = node.next_marked;
      ++count.marked;
      if (level == 1) count.changed += static_cast<unsigned>(std::popcount(node.dirty));
      node.dirty = 0;
      const unsigned lane = node.id & 7u;
      const lanes::Bounds bounds = node.mask != 0 ? bounds_of(node) : kNoBounds;
      if (level == 1 && detector_count > 0) notify(at != root_ ? &nodes[node.parent] : nullptr, lane, bounds);
      if (node.mask == 0) {
        if (at == root_) {
          root_ = kNone;
        } else {
          TreeNode& above = nodes[node.parent];
          above.mask = static_cast<std::uint8_t>(above.mask & ~(1u << lane));
          clear_lane(above, lane);
          mark_child(node.parent, above, lane);
        }
        nodes_.index_.erase(NodePool::key(node), index(at), nodes_.key_of_node());
        nodes_.free_.release(index(at));
      } else if (at != root_) {
        TreeNode& above = nodes[node.parent];
        if (set_box(above, lane, bounds)) mark_child(node.parent, above, lane);
      }
      at = next;
    }
  }
  if (count.marked > 0) version_ = ++nodes_.newest_version_;
  // If a surface moves from one side of a sphere to the other, no changed box may intersect the sphere, but the box of
  // all changes contains it.
  for (std::uint32_t i = 0; i < detector_count && count.marked > 0; ++i) {
    ChangeDetector& detector = change_detectors[i];
    if (height_ == 1) detector.squared_distance = 0;
    detector.is_changed = detector.is_changed || detector.squared_distance <= detector.radius * detector.radius ||
                          contains(all, detector);
  }
  for (std::uint32_t level = 1; level <= height_; ++level) {
    const std::uint64_t of_level = (std::uint64_t{finest_faces_} + (1ull << 3 * level) - 1) >> 3 * level;
    count.bound += static_cast<std::uint32_t>(std::min<std::uint64_t>(count.changed, of_level));
  }
  TACTUS_ASSERT(count.marked <= count.bound);
  return count;
}

std::vector<LeafLane> AbTree::shown() const {
  std::vector<LeafLane> leaf_lanes;
  std::vector<NodeIndex> stack;
  if (root_ != kNone) stack.push_back(root_);
  while (!stack.empty()) {
    const NodeIndex at = stack.back();
    const TreeNode& node = nodes_[at];
    stack.pop_back();
    if (node.level > 1) {
      for (unsigned bits = node.mask; bits != 0; bits &= ~(1u << highest_bit(bits)))
        stack.push_back(node.node(highest_bit(bits)));
    } else {
      for (unsigned bits = node.mask; bits != 0; bits &= bits - 1)
        leaf_lanes.emplace_back(at, static_cast<unsigned>(std::countr_zero(bits)));
    }
  }
  return leaf_lanes;
}

std::vector<std::string> AbTree::violations() const {
  std::vector<std::string> found;
  std::vector<NodeIndex> stack;
  if (root_ != kNone) stack.push_back(root_);
  while (!stack.empty()) {
    const NodeIndex at = stack.back();
    stack.pop_back();
    const TreeNode& node = nodes_[at];
    const std::string name = "node " + std::to_string(node.id) + " of level " + std::to_string(node.level);
    if (node.dirty != 0) found.push_back(name + " is still marked");
    if (node.mask == 0) found.push_back(name + " is empty");
    if (nodes_.find(NodePool::key(object_, node.level, node.id)) != at) found.push_back(name + " is not indexed");
    for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
      TreeNode expected = node;
      const bool is_leaf = node.level == 1, is_present = (node.mask >> i & 1u) != 0;
      if (!is_leaf || !is_present) clear_lane(expected, i);
      if (is_present && !is_leaf) {
        const TreeNode& below = nodes_[node.node(i)];
        if (below.parent != at || below.level + 1 != node.level || below.id != node.id * 8 + i)
          found.push_back(name + " has a child with another parent, level or id");
        set_box(expected, i, bounds_of(below));
        stack.push_back(node.node(i));
      }
      const std::size_t rows = is_leaf ? lanes::kTriangleRows : lanes::kBoxRows;
      for (std::size_t k = 0; k < rows; ++k)
        if (std::memcmp(&expected.lanes[k][i], &node.lanes[k][i], sizeof(float)) != 0) {
          found.push_back(name + " has old coordinates or a wrong box for child " + std::to_string(i));
          break;
        }
    }
  }
  return found;
}

}  // namespace tactus::spm
