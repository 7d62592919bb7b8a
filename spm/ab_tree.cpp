#include "spm/ab_tree.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace tactus::spm {
namespace {

constexpr float kNothing = std::numeric_limits<float>::quiet_NaN();

constexpr std::array<lanes::Floats, lanes::kTriangleRows> no_lanes() noexcept {
  std::array<lanes::Floats, lanes::kTriangleRows> rows{};
  for (lanes::Floats& row : rows)
    for (float& lane : row) lane = kNothing;
  return rows;
}
constexpr auto kNoLanes = no_lanes();

void clear_lane(TreeNode& node, unsigned lane) noexcept {
  for (lanes::Floats& row : node.lanes) row[lane] = kNothing;
}

lanes::Bounds bounds_of(const TreeNode& node) noexcept {
  lanes::Bounds bounds;
  if (node.level == 1)
    lanes::kBest.bounds_of_triangles(node.lanes.data(), bounds);
  else
    lanes::kBest.bounds_of_boxes(node.lanes.data(), bounds);
  return bounds;
}

/// False when the child's box was that already.
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

/// The query's centre, also as floats, and by how much a float distance computed with it may exceed the true one.
struct FloatPoint {
  explicit FloatPoint(const Vec3d& p) noexcept
      : exact{p[0], p[1], p[2]},
        at{static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])},
        slack{p.cwiseAbs().maxCoeff() * 4e-7} {}
  std::array<double, 3> exact;
  std::array<float, 3> at;
  double slack;

  /// Squared radius that finds at least all boxes within `radius` of the true centre.
  [[nodiscard]] float squared(double radius) const noexcept {
    const double grown = radius * (1 + 1e-6) + slack;
    return static_cast<float>(grown * grown);
  }
};

inline Vec3d corner(const TreeNode& node, unsigned lane, int number) noexcept {
  return {node.lanes[3 * number][lane], node.lanes[3 * number + 1][lane], node.lanes[3 * number + 2][lane]};
}

inline unsigned lowest_bit(unsigned bits) noexcept { return static_cast<unsigned>(__builtin_ctz(bits)); }
inline unsigned bit_count(std::uint8_t bits) noexcept {
  constexpr std::uint64_t kOfNibble = 0x4332322132212110u;
  return static_cast<unsigned>((kOfNibble >> 4 * (bits & 15)) & 15u) +
         static_cast<unsigned>(kOfNibble >> 4 * (bits >> 4) & 15u);
}
inline unsigned highest_bit(unsigned bits) noexcept { return 31u - static_cast<unsigned>(__builtin_clz(bits)); }

[[gnu::noinline]] Vec3d upright(const TreeNode& node, unsigned lane) noexcept {
  const Vec3d a = corner(node, lane, 0);
  const Vec3d across = (corner(node, lane, 1) - a).cross(corner(node, lane, 2) - a);
  const double length = across.norm();
  return length > 0 ? Vec3d{across / length} : Vec3d::UnitZ();
}

}  // namespace

NodePool::NodePool(std::uint32_t nodes) : nodes_(nodes), free_{nodes}, index_{nodes} {}

AbTree::AbTree(Pool& pool, NodePool& nodes, std::uint32_t object, std::uint32_t finest_faces)
    : pool_{pool}, nodes_{nodes}, object_{object}, finest_faces_{finest_faces} {
  marked_.fill(kNone);
  while ((std::uint64_t{1} << 3 * height_) < finest_faces) ++height_;
}

std::uint32_t AbTree::make_leaf(std::uint32_t id) noexcept {
  const auto key = [&](std::uint32_t level) { return NodePool::key(object_, level, id >> 3 * (level - 1)); };
  std::uint32_t slot = kNone, level = 1;  // the lowest that is there
  for (; level <= height_; ++level) {
    slot = nodes_.index_.find(key(level));
    if (slot != kNone) break;
  }
  std::uint32_t near = slot;
  if (slot != kNone && level > 1 && nodes_[slot].mask != 0) near = nodes_[slot].child[lowest_bit(nodes_[slot].mask)];
  while (level > 1) {
    const std::uint32_t above = slot;
    --level;
    TACTUS_ASSERT(nodes_.free() > 0);
    slot = near = nodes_.free_.take(near != kNone ? near : 0);
    TreeNode& node = nodes_.nodes_[slot];
    node.lanes = kNoLanes;
    node.parent = above;
    node.id = id >> 3 * (level - 1);
    node.level = static_cast<std::uint8_t>(level);
    node.mask = 0;
    node.dirty = 0;
    node.last = 0;
    nodes_.index_.insert(key(level), slot);
    if (above == kNone) {
      root_ = slot;
    } else {
      TreeNode& parent = nodes_.nodes_[above];
      parent.child[node.id & 7u] = slot;
      parent.mask = static_cast<std::uint8_t>(parent.mask | 1u << (node.id & 7u));
    }
  }
  return slot;
}

void AbTree::insert(std::uint32_t row_index) noexcept {
  FaceRow& row = pool_.faces[row_index];
  TACTUS_ASSERT(row.node == kNone && row.face < finest_faces_);
  const std::uint32_t slot = make_leaf(row.face >> 3);
  TreeNode& node = nodes_.nodes_[slot];
  const unsigned lane = row.face & 7u;
  node.child[lane] = row_index;
  node.mask = static_cast<std::uint8_t>(node.mask | 1u << lane);
  row.node = slot;
  const Vertex* vertices = pool_.vertices.data();
  for (std::uint32_t corner = 0; corner < 3; ++corner) node.set_corner(lane, corner, vertices[row.vertices[corner]]);
  node.set_last(lane, row.last != 0);
  mark_child(slot, node, lane);
}

void AbTree::remove(std::uint32_t row_index) noexcept {
  FaceRow& row = pool_.faces[row_index];
  TACTUS_ASSERT(row.node != kNone);
  TreeNode& node = nodes_.nodes_[row.node];
  const unsigned lane = row.face & 7u;
  node.mask = static_cast<std::uint8_t>(node.mask & ~(1u << lane));
  clear_lane(node, lane);
  mark_child(row.node, node, lane);
  row.node = kNone;
}

std::uint32_t AbTree::copy_leaves(std::uint32_t from, TreeNode* out, std::uint32_t capacity) const noexcept {
  std::uint32_t copied = 0;
  std::array<std::uint32_t, kStack> stack;
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
      // Ids of level 1 that it covers end here.
      const std::uint64_t end = (std::uint64_t{node.id} * TreeNode::kWidth + child + 1) << 3 * (node.level - 2);
      if (end <= from) break;
      stack[depth++] = node.child[child];
      prefetch(node.child[child]);
    }
  }
  return copied;
}

std::array<float, 9> AbTree::corners(std::uint32_t row_index) const noexcept {
  const FaceRow& row = pool_.faces[row_index];
  TACTUS_ASSERT(row.node != kNone);
  std::array<float, 9> corners;
  for (std::size_t i = 0; i < corners.size(); ++i) corners[i] = nodes_[row.node].lanes[i][row.face & 7u];
  return corners;
}

RefitCount AbTree::refit() noexcept {
  RefitCount count;
  TreeNode* nodes = nodes_.nodes_.data();
  for (std::uint32_t level = 1; level <= height_; ++level) {
    std::uint32_t slot = marked_[level];
    marked_[level] = kNone;
    while (slot != kNone) {
      TreeNode& node = nodes[slot];
      const std::uint32_t next = node.next_marked;
      ++count.marked;
      if (level == 1) count.changed += bit_count(node.dirty);
      node.dirty = 0;
      const unsigned lane = node.id & 7u;
      if (node.mask == 0) {
        if (slot == root_) {
          root_ = kNone;
        } else {
          TreeNode& above = nodes[node.parent];
          above.mask = static_cast<std::uint8_t>(above.mask & ~(1u << lane));
          clear_lane(above, lane);
          mark_child(node.parent, above, lane);
        }
        nodes_.index_.erase(NodePool::key(object_, level, node.id));
        nodes_.free_.give(slot);
      } else if (slot != root_) {
        TreeNode& above = nodes[node.parent];
        if (set_box(above, lane, bounds_of(node))) mark_child(node.parent, above, lane);
      }
      slot = next;
    }
  }
  for (std::uint32_t level = 1; level <= height_; ++level) {
    const std::uint64_t of_level = (std::uint64_t{finest_faces_} + (1ull << 3 * level) - 1) >> 3 * level;
    count.bound += static_cast<std::uint32_t>(std::min<std::uint64_t>(count.changed, of_level));
  }
  TACTUS_ASSERT(count.marked <= count.bound);
  return count;
}

/// Memory is what a query costs that runs once a millisecond: nodes of one level are taken together, so that what they
/// lead to is on its way at the same time. Leaves take long enough that a few ahead will do; more would wait in line.
template <class Visit>
void AbTree::walk_near(const Vec3d& point, double radius, Visit&& visit) const noexcept {
  if (root_ == kNone) return;
  const FloatPoint p{point};
  const float squared_radius = p.squared(radius);
  constexpr std::uint32_t kTogether = 32, kLeavesAhead = 8;
  struct Waiting {
    std::uint32_t first = 0, last = 0;  // of `queue`
  };
  std::array<Waiting, kMaxHeight + 1> waiting{};  // by level; that of a level stands behind those above
  std::array<std::uint32_t, 1 + TreeNode::kWidth * kTogether*(kMaxHeight - 1)> queue;
  queue[0] = root_;
  waiting[height_].last = 1;
  for (std::uint32_t level = height_; level <= height_;) {
    Waiting& here = waiting[level];
    if (level == 1) {
      for (; here.first < here.last; ++here.first) {
        if (here.first + kLeavesAhead < here.last) prefetch(queue[here.first + kLeavesAhead]);
        const TreeNode& node = nodes_[queue[here.first]];
        const unsigned near = lanes::kBest.triangles_within(node.lanes.data(), p.at, squared_radius);
        if (near != 0) visit(node, near);
      }
    }
    if (here.first == here.last) {
      ++level;
      continue;
    }
    std::uint32_t behind = here.last;
    Waiting& below = waiting[--level];
    below.first = behind;
    for (const std::uint32_t end = std::min(here.last, here.first + kTogether); here.first < end; ++here.first) {
      const TreeNode& node = nodes_[queue[here.first]];
      for (unsigned hit = lanes::kBest.boxes_within(node.lanes.data(), p.at, squared_radius); hit != 0;
           hit &= hit - 1) {
        const std::uint32_t child = node.child[lowest_bit(hit)];
        if (level > 1 || behind < below.first + kLeavesAhead) prefetch(child);
        queue[behind++] = child;
      }
    }
    below.last = behind;
  }
}

std::uint32_t AbTree::touching(const Vec3d& centre, double radius, Contact* out,
                               std::uint32_t capacity) const noexcept {
  struct Leaf {
    const TreeNode* node = nullptr;
    unsigned touched = 0;
    lanes::Touches touches;
  };
  // Contacts are written one leaf later: what has just been stored by eight is slow to read one by one.
  std::array<Leaf, 2> leaves;
  unsigned current = 0;
  std::uint32_t count = 0;
  const auto write = [&](const Leaf& leaf) {
    const lanes::Touches& touches = leaf.touches;
    std::uint32_t at = count;
    for (unsigned left = leaf.touched; left != 0; left &= left - 1, ++at) {
      if (at >= capacity) continue;
      const unsigned i = lowest_bit(left);
      Contact& contact = out[at];
      contact.face = FaceId{leaf.node->id * TreeNode::kWidth + i};
      contact.last = (leaf.node->last >> i & 1u) != 0;
      contact.point = {touches.point[0][i], touches.point[1][i], touches.point[2][i]};
      contact.normal = {touches.normal[0][i], touches.normal[1][i], touches.normal[2][i]};
      contact.depth = touches.depth[i];
      contact.row = leaf.node->child[i];
      if (contact.depth == radius) contact.normal = upright(*leaf.node, i);
    }
    count = at;
  };
  const std::array<double, 3> p{centre[0], centre[1], centre[2]};
  walk_near(centre, radius, [&](const TreeNode& node, unsigned near) {
    Leaf& leaf = leaves[current];
    current ^= 1;
    leaf.node = &node;
    leaf.touched = lanes::kBest.touches(node.lanes.data(), p, near, radius, leaf.touches);
    write(leaves[current]);
  });
  write(leaves[current ^ 1]);
  return count;
}

bool AbTree::sweep(const Vec3d& from, const Vec3d& to, double radius, SweepContact& first) const noexcept {
  if (root_ == kNone) return false;
  const double slack = 4e-7 * std::max(from.cwiseAbs().maxCoeff(), to.cwiseAbs().maxCoeff());
  std::array<float, 3> low, high;
  FloatPoint middle{from};
  float squared_reach = 0;
  const auto bound_motion = [&](double time) noexcept {
    const Vec3d end = from + time * (to - from);
    middle = FloatPoint{from + (end - from) / 2};
    squared_reach = middle.squared(radius + (end - from).norm() / 2);
    for (int axis = 0; axis < 3; ++axis) {
      const double grown = radius * (1 + 1e-6) + slack;
      low[axis] = static_cast<float>(std::min(from[axis], end[axis]) - grown);
      high[axis] = static_cast<float>(std::max(from[axis], end[axis]) + grown);
    }
  };
  bool found = false;
  const auto search = [&](double time) noexcept {
    bound_motion(time);
    std::array<std::uint32_t, kStack> stack;
    int depth = 0;
    stack[depth++] = root_;
    while (depth > 0) {
      const TreeNode& node = nodes_[stack[--depth]];
      if (node.level > 1) {
        // A short motion is best bounded by a ball, a long one by a box.
        unsigned hit = lanes::kBest.boxes_within(node.lanes.data(), middle.at, squared_reach) &
                       lanes::kBest.boxes_meeting(node.lanes.data(), low, high);
        for (; hit != 0; hit &= ~(1u << highest_bit(hit))) stack[depth++] = node.child[highest_bit(hit)];
        continue;
      }
      const unsigned near = lanes::kBest.triangles_within(node.lanes.data(), middle.at, squared_reach);
      if (near == 0) continue;
      lanes::Closest closest;
      lanes::kBest.closest_points(node.lanes.data(), middle.exact, near, closest);
      const float squared_reach_here = squared_reach;  // goes with this middle; a touch shortens the motion
      for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
        if (!(closest.squared_distance[i] <= squared_reach_here)) continue;
        SweepHit touch;
        if (!swept_sphere(from, to, radius, corner(node, i, 0), corner(node, i, 1), corner(node, i, 2), touch))
          continue;
        if (found && !(touch.time < first.time)) continue;
        found = true;
        first = {FaceId{node.id * TreeNode::kWidth + i}, touch.time, touch.point, touch.normal};
        bound_motion(std::min(time, touch.time));
      }
    }
  };
  // A proxy that rests on a surface is stopped at once: look there first, where few faces are.
  constexpr double kAtOnce = 0.01;  // of the radius
  const double length = (to - from).norm();
  const double at_once = length > 0 ? kAtOnce * radius / length : 1;
  if (at_once < 0.5) {
    search(at_once);
    if (found && first.time <= at_once) return true;
  }
  search(found ? first.time : 1);
  return found;
}

std::uint32_t AbTree::nearest(const Vec3d& point, double within, double more, NearestFace& best, std::uint32_t* rows,
                              std::uint32_t capacity) const noexcept {
  if (root_ == kNone) return 0;
  const FloatPoint p{point};
  best.squared_distance = within * within;
  double squared_more = (within + more) * (within + more);
  float squared_limit = p.squared(within + more);
  struct Near {
    std::uint32_t face, row;
    double squared;
  };
  std::array<Near, kMostNearest> near_faces;
  std::uint32_t near_count = 0;
  capacity = std::min(capacity, kMostNearest);
  const auto drop_far = [&]() noexcept {
    std::uint32_t kept = 0;
    for (std::uint32_t i = 0; i < near_count; ++i)
      if (near_faces[i].squared <= squared_more) near_faces[kept++] = near_faces[i];
    near_count = kept;
  };
  struct Entry {
    std::uint32_t node;
    float squared;
  };
  std::array<Entry, kStack> stack;
  int depth = 0;
  stack[depth++] = {root_, 0};
  bool found = false;
  while (depth > 0) {
    const Entry entry = stack[--depth];
    if (entry.squared > squared_limit) continue;
    const TreeNode& node = nodes_[entry.node];
    if (node.level > 1) {
      lanes::Floats squared;
      lanes::kBest.box_distances(node.lanes.data(), p.at, squared);
      const int first = depth;
      for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
        if (!(squared[i] <= squared_limit)) continue;
        int place = depth++;  // farthest first, so that the nearest is taken next
        for (; place > first && stack[place - 1].squared < squared[i]; --place) stack[place] = stack[place - 1];
        stack[place] = {node.child[i], squared[i]};
        prefetch(node.child[i]);
      }
      continue;
    }
    const unsigned near = lanes::kBest.triangles_within(node.lanes.data(), p.at, squared_limit);
    if (near == 0) continue;
    lanes::Closest closest;
    lanes::kBest.closest_points(node.lanes.data(), p.exact, near, closest);
    for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
      const double squared = closest.squared_distance[i];
      if (!(squared <= squared_more)) continue;
      const std::uint32_t face = node.id * TreeNode::kWidth + i;
      const bool nearer =
          squared < best.squared_distance || (squared == best.squared_distance && (!found || face < index(best.face)));
      if (nearer) {
        found = true;
        best = {FaceId{face}, {closest.point[0][i], closest.point[1][i], closest.point[2][i]}, squared, node.child[i]};
        const double limit = std::sqrt(squared) + more;
        squared_more = std::max(squared, limit * limit);
        squared_limit = p.squared(limit);
      }
      if (capacity == 0) continue;
      if (near_count == capacity) drop_far();
      if (near_count < capacity) near_faces[near_count++] = {face, node.child[i], squared};
    }
  }
  if (!found) return 0;
  drop_far();
  std::sort(near_faces.begin(), near_faces.begin() + near_count,
            [](const Near& a, const Near& b) { return a.face < b.face; });
  for (std::uint32_t i = 0; i < near_count; ++i) rows[i] = near_faces[i].row;
  return std::max(1u, near_count);
}

std::vector<std::uint32_t> AbTree::shown() const {
  std::vector<std::uint32_t> rows;
  std::vector<std::uint32_t> stack;
  if (root_ != kNone) stack.push_back(root_);
  while (!stack.empty()) {
    const TreeNode& node = nodes_[stack.back()];
    stack.pop_back();
    if (node.level > 1) {
      for (unsigned bits = node.mask; bits != 0; bits &= ~(1u << highest_bit(bits)))
        stack.push_back(node.child[highest_bit(bits)]);
    } else {
      for (unsigned bits = node.mask; bits != 0; bits &= bits - 1) rows.push_back(node.child[lowest_bit(bits)]);
    }
  }
  return rows;
}

std::vector<std::string> AbTree::violations() const {
  std::vector<std::string> found;
  std::vector<std::uint32_t> stack;
  if (root_ != kNone) stack.push_back(root_);
  while (!stack.empty()) {
    const std::uint32_t slot = stack.back();
    stack.pop_back();
    const TreeNode& node = nodes_[slot];
    const std::string name = "node " + std::to_string(node.id) + " of level " + std::to_string(node.level);
    if (node.dirty != 0) found.push_back(name + " is still marked");
    if (node.mask == 0) found.push_back(name + " is empty");
    if (nodes_.index_.find(NodePool::key(object_, node.level, node.id)) != slot)
      found.push_back(name + " is not indexed");
    for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
      TreeNode expected = node;
      clear_lane(expected, i);
      if ((node.mask >> i & 1u) != 0 && node.level == 1) {
        const FaceRow& row = pool_.faces[node.child[i]];
        if (row.face != node.id * 8 + i || row.node != slot) found.push_back(name + " holds a row that is not its own");
        if ((node.last >> i & 1u) != row.last)
          found.push_back(name + " has a wrong version of child " + std::to_string(i));
        for (std::size_t k = 0; k < lanes::kTriangleRows; ++k)
          expected.lanes[k][i] = pool_.vertices[row.vertices[k / 3]].position[k % 3];
      } else if ((node.mask >> i & 1u) != 0) {
        const TreeNode& below = nodes_[node.child[i]];
        if (below.parent != slot || below.level + 1 != node.level || below.id != node.id * 8 + i)
          found.push_back(name + " has a child that does not know it");
        set_box(expected, i, bounds_of(below));
        stack.push_back(node.child[i]);
      }
      const std::size_t rows = node.level == 1 ? lanes::kTriangleRows : lanes::kBoxRows;
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
