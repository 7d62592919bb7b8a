#include "spm/ab_tree.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace tactus::spm {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();

void clear_box(TreeNode& node, unsigned child) noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    node.low[axis][child] = kInfinity;
    node.high[axis][child] = -kInfinity;
  }
}

void set_box_of_face(TreeNode& node, unsigned child, const FaceRow& row) noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    const float a = row.corners[axis], b = row.corners[3 + axis], c = row.corners[6 + axis];
    node.low[axis][child] = std::min(a, std::min(b, c));
    node.high[axis][child] = std::max(a, std::max(b, c));
  }
}

void set_box_of_node(TreeNode& node, unsigned child, const TreeNode& below) noexcept {
  for (int axis = 0; axis < 3; ++axis) {
    float low = kInfinity, high = -kInfinity;
    for (int i = 0; i < TreeNode::kWidth; ++i) {
      low = std::min(low, below.low[axis][i]);
      high = std::max(high, below.high[axis][i]);
    }
    node.low[axis][child] = low;
    node.high[axis][child] = high;
  }
}

/// The query's centre as floats, and by how much a float distance computed with it may exceed the true one.
struct FloatPoint {
  explicit FloatPoint(const Vec3d& p) noexcept
      : at{static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])},
        slack{p.cwiseAbs().maxCoeff() * 4e-7} {}
  std::array<float, 3> at;
  double slack;

  /// Squared radius that finds at least all boxes within `radius` of the true centre.
  [[nodiscard]] float squared(double radius) const noexcept {
    const double grown = radius * (1 + 1e-6) + slack;
    return static_cast<float>(grown * grown);
  }
};

/// Squared distances from the point to the boxes of all children; infinite where there is none.
inline void squared_distances(const TreeNode& node, const std::array<float, 3>& p, float* out) noexcept {
  for (int i = 0; i < TreeNode::kWidth; ++i) out[i] = 0;
  for (int axis = 0; axis < 3; ++axis)
    for (int i = 0; i < TreeNode::kWidth; ++i) {
      const float below = node.low[axis][i] - p[axis];
      const float above = p[axis] - node.high[axis][i];
      const float outside = below > above ? below : above;
      const float d = outside > 0 ? outside : 0;
      out[i] += d * d;
    }
}

inline unsigned boxes_within(const TreeNode& node, const std::array<float, 3>& p, float squared_radius) noexcept {
  float squared[TreeNode::kWidth];
  squared_distances(node, p, squared);
  unsigned hit = 0;
  for (unsigned i = 0; i < TreeNode::kWidth; ++i) hit |= static_cast<unsigned>(squared[i] <= squared_radius) << i;
  return hit;
}

inline unsigned boxes_meeting(const TreeNode& node, const std::array<float, 3>& low,
                              const std::array<float, 3>& high) noexcept {
  unsigned hit = 0;
  for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
    bool meets = true;
    for (int axis = 0; axis < 3; ++axis)
      meets = meets & (node.low[axis][i] <= high[axis]) & (node.high[axis][i] >= low[axis]);
    hit |= static_cast<unsigned>(meets) << i;
  }
  return hit;
}

inline Vec3d corner(const FaceRow& row, int i) noexcept {
  return {row.corners[3 * i], row.corners[3 * i + 1], row.corners[3 * i + 2]};
}

inline unsigned lowest_bit(unsigned bits) noexcept { return static_cast<unsigned>(__builtin_ctz(bits)); }
inline unsigned highest_bit(unsigned bits) noexcept { return 31u - static_cast<unsigned>(__builtin_clz(bits)); }

Vec3d direction_from(const Vec3d& point, const Vec3d& centre, double distance, const FaceRow& row) noexcept {
  if (distance > 0) return (centre - point) / distance;
  const Vec3d a = corner(row, 0);
  const Vec3d across = (corner(row, 1) - a).cross(corner(row, 2) - a);
  const double length = across.norm();
  return length > 0 ? Vec3d{across / length} : Vec3d::UnitZ();
}

}  // namespace

NodePool::NodePool(std::uint32_t nodes) : nodes_(nodes), free_(nodes), index_{nodes} {
  for (std::uint32_t i = 0; i < nodes; ++i) free_[i] = nodes - 1 - i;
}

AbTree::AbTree(Pool& pool, NodePool& nodes, std::uint32_t object, std::uint32_t finest_faces)
    : pool_{pool}, nodes_{nodes}, object_{object}, finest_faces_{finest_faces} {
  marked_.fill(kNone);
  while ((std::uint64_t{1} << 3 * height_) < finest_faces) ++height_;
}

std::uint32_t AbTree::make_node(std::uint32_t level, std::uint32_t id) noexcept {
  std::uint32_t bottom = kNone;
  std::uint32_t below = kNone;
  unsigned below_bit = 0;
  while (true) {
    std::uint32_t slot = nodes_.index_.find(NodePool::key(object_, level, id));
    const bool fresh = slot == kNone;
    if (fresh) {
      TACTUS_ASSERT(nodes_.free() > 0);
      slot = nodes_.free_[nodes_.nodes_.size() - ++nodes_.used_];
      TreeNode& node = nodes_.nodes_[slot];
      for (unsigned i = 0; i < TreeNode::kWidth; ++i) clear_box(node, i);
      node.parent = kNone;
      node.id = id;
      node.level = static_cast<std::uint8_t>(level);
      node.mask = 0;
      node.dirty = 0;
      nodes_.index_.insert(NodePool::key(object_, level, id), slot);
    }
    if (below == kNone) {
      bottom = slot;
    } else {
      TreeNode& node = nodes_.nodes_[slot];
      node.child[below_bit] = below;
      node.mask = static_cast<std::uint8_t>(node.mask | 1u << below_bit);
      nodes_.nodes_[below].parent = slot;
    }
    if (!fresh) return bottom;
    if (level == height_) {
      root_ = slot;
      return bottom;
    }
    below = slot;
    below_bit = id & 7u;
    id >>= 3;
    ++level;
  }
}

void AbTree::mark_child(std::uint32_t slot, unsigned child) noexcept {
  while (slot != kNone) {
    TreeNode& node = nodes_.nodes_[slot];
    const bool marked = node.dirty != 0;
    node.dirty = static_cast<std::uint8_t>(node.dirty | 1u << child);
    if (marked) return;
    node.next_marked = marked_[node.level];
    marked_[node.level] = slot;
    child = node.id & 7u;
    slot = node.parent;
  }
}

void AbTree::insert(std::uint32_t row_index) noexcept {
  FaceRow& row = pool_.faces[row_index];
  TACTUS_ASSERT(row.node == kNone && row.face < finest_faces_);
  const std::uint32_t slot = make_node(1, row.face >> 3);
  TreeNode& node = nodes_.nodes_[slot];
  const unsigned bit = row.face & 7u;
  node.child[bit] = row_index;
  node.mask = static_cast<std::uint8_t>(node.mask | 1u << bit);
  row.node = slot;
  mark_child(slot, bit);
}

void AbTree::remove(std::uint32_t row_index) noexcept {
  FaceRow& row = pool_.faces[row_index];
  TACTUS_ASSERT(row.node != kNone);
  TreeNode& node = nodes_.nodes_[row.node];
  const unsigned bit = row.face & 7u;
  node.mask = static_cast<std::uint8_t>(node.mask & ~(1u << bit));
  mark_child(row.node, bit);
  row.node = kNone;
}

void AbTree::mark(std::uint32_t row_index) noexcept {
  const FaceRow& row = pool_.faces[row_index];
  TACTUS_ASSERT(row.node != kNone);
  mark_child(row.node, row.face & 7u);
}

RefitCount AbTree::refit() noexcept {
  RefitCount count;
  for (std::uint32_t level = 1; level <= height_; ++level) {
    std::uint32_t slot = marked_[level];
    marked_[level] = kNone;
    while (slot != kNone) {
      TreeNode& node = nodes_.nodes_[slot];
      ++count.marked;
      for (unsigned bits = node.dirty; bits != 0; bits &= bits - 1) {
        const unsigned child = lowest_bit(bits);
        if (level == 1) {
          ++count.changed;
          if ((node.mask >> child & 1u) != 0)
            set_box_of_face(node, child, pool_.faces[node.child[child]]);
          else
            clear_box(node, child);
          continue;
        }
        const TreeNode& below = nodes_.nodes_[node.child[child]];
        if (below.mask != 0) {
          set_box_of_node(node, child, below);
          continue;
        }
        nodes_.index_.erase(NodePool::key(object_, level - 1, below.id));
        nodes_.free_[nodes_.nodes_.size() - nodes_.used_--] = node.child[child];
        node.mask = static_cast<std::uint8_t>(node.mask & ~(1u << child));
        clear_box(node, child);
      }
      node.dirty = 0;
      slot = node.next_marked;
    }
  }
  if (root_ != kNone && nodes_[root_].mask == 0) {
    nodes_.index_.erase(NodePool::key(object_, height_, 0));
    nodes_.free_[nodes_.nodes_.size() - nodes_.used_--] = root_;
    root_ = kNone;
  }
  for (std::uint32_t level = 1; level <= height_; ++level) {
    const std::uint64_t of_level = (std::uint64_t{finest_faces_} + (1ull << 3 * level) - 1) >> 3 * level;
    count.bound += static_cast<std::uint32_t>(std::min<std::uint64_t>(count.changed, of_level));
  }
  TACTUS_ASSERT(count.marked <= count.bound);
  return count;
}

template <class Visit>
void AbTree::walk_near(const Vec3d& point, double radius, Visit&& visit) const noexcept {
  if (root_ == kNone) return;
  const FloatPoint p{point};
  const float squared_radius = p.squared(radius);
  std::array<std::uint32_t, kStack> stack;
  int depth = 0;
  stack[depth++] = root_;
  while (depth > 0) {
    const TreeNode& node = nodes_[stack[--depth]];
    unsigned hit = boxes_within(node, p.at, squared_radius);
    if (node.level > 1) {
      for (; hit != 0; hit &= ~(1u << highest_bit(hit))) stack[depth++] = node.child[highest_bit(hit)];
      continue;
    }
    for (; hit != 0; hit &= hit - 1) visit(node.child[lowest_bit(hit)]);
  }
}

std::uint32_t AbTree::near(const Vec3d& point, double radius, std::uint32_t* rows,
                           std::uint32_t capacity) const noexcept {
  std::uint32_t found = 0;
  walk_near(point, radius, [&](std::uint32_t number) {
    if (found < capacity) rows[found] = number;
    ++found;
  });
  return found;
}

std::uint32_t AbTree::touching(const Vec3d& centre, double radius, Contact* out,
                               std::uint32_t capacity) const noexcept {
  std::uint32_t found = 0;
  walk_near(centre, radius, [&](std::uint32_t number) {
    const FaceRow& row = pool_.faces[number];
    const ClosestPoint closest = closest_point(centre, corner(row, 0), corner(row, 1), corner(row, 2));
    if (!(closest.squared_distance <= radius * radius)) return;
    if (found < capacity) {
      const double distance = std::sqrt(closest.squared_distance);
      out[found] = {FaceId{row.face},  row.last != 0,
                    closest.point,     direction_from(closest.point, centre, distance, row),
                    radius - distance, number};
    }
    ++found;
  });
  return found;
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
      // A short motion is best bounded by a ball, a long one by a box.
      unsigned hit = boxes_within(node, middle.at, squared_reach) & boxes_meeting(node, low, high);
      if (node.level > 1) {
        for (; hit != 0; hit &= ~(1u << highest_bit(hit))) stack[depth++] = node.child[highest_bit(hit)];
        continue;
      }
      for (; hit != 0; hit &= hit - 1) {
        const FaceRow& row = pool_.faces[node.child[lowest_bit(hit)]];
        SweepHit touch;
        if (!swept_sphere(from, to, radius, corner(row, 0), corner(row, 1), corner(row, 2), touch)) continue;
        if (found && !(touch.time < first.time)) continue;
        found = true;
        first = {FaceId{row.face}, touch.time, touch.point, touch.normal};
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

bool AbTree::nearest(const Vec3d& point, double within, NearestFace& best) const noexcept {
  if (root_ == kNone) return false;
  const FloatPoint p{point};
  best.squared_distance = within * within;
  float squared_limit = p.squared(within);
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
    float squared[TreeNode::kWidth];
    squared_distances(node, p.at, squared);
    if (node.level > 1) {
      const int first = depth;
      for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
        if (!(squared[i] <= squared_limit)) continue;
        int place = depth++;  // farthest first, so that the nearest is taken next
        for (; place > first && stack[place - 1].squared < squared[i]; --place) stack[place] = stack[place - 1];
        stack[place] = {node.child[i], squared[i]};
      }
      continue;
    }
    for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
      if (!(squared[i] <= squared_limit)) continue;
      const FaceRow& row = pool_.faces[node.child[i]];
      const ClosestPoint closest = closest_point(point, corner(row, 0), corner(row, 1), corner(row, 2));
      const bool nearer =
          closest.squared_distance < best.squared_distance ||
          (closest.squared_distance == best.squared_distance && (!found || row.face < index(best.face)));
      if (!nearer) continue;
      found = true;
      best = {FaceId{row.face}, closest.point, closest.squared_distance, node.child[i]};
      squared_limit = p.squared(std::sqrt(closest.squared_distance));
    }
  }
  return found;
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
      if ((node.mask >> i & 1u) == 0) {
        clear_box(expected, i);
      } else if (node.level == 1) {
        const FaceRow& row = pool_.faces[node.child[i]];
        if (row.face != node.id * 8 + i || row.node != slot) found.push_back(name + " holds a row that is not its own");
        set_box_of_face(expected, i, row);
      } else {
        const TreeNode& below = nodes_[node.child[i]];
        if (below.parent != slot || below.level + 1 != node.level || below.id != node.id * 8 + i)
          found.push_back(name + " has a child that does not know it");
        set_box_of_node(expected, i, below);
        stack.push_back(node.child[i]);
      }
      for (int axis = 0; axis < 3; ++axis)
        if (expected.low[axis][i] != node.low[axis][i] || expected.high[axis][i] != node.high[axis][i]) {
          found.push_back(name + " has a wrong box for child " + std::to_string(i));
          break;
        }
    }
  }
  return found;
}

}  // namespace tactus::spm
