#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "spm/ab_tree.hpp"

namespace tactus::spm {
namespace {

/// The centre of a query in double and float.
struct FloatPoint {
  explicit FloatPoint(const Vec3d& p) noexcept
      : exact{p[0], p[1], p[2]},
        at{static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])},
        slack{p.cwiseAbs().maxCoeff() * 4e-7} {}
  std::array<double, 3> exact;
  std::array<float, 3> at;
  double slack;  ///< max error of a distance computed in float

  /// Returns a squared radius for float that finds at least all boxes within `radius` of the exact centre.
  [[nodiscard]] float squared(double radius) const noexcept {
    const double grown = radius * (1 + 1e-6) + slack;
    return static_cast<float>(grown * grown);
  }
};

inline Vec3d corner(const TreeNode& node, unsigned lane, int number) noexcept {
  return {node.lanes[3 * number][lane], node.lanes[3 * number + 1][lane], node.lanes[3 * number + 2][lane]};
}

inline unsigned highest_bit(unsigned bits) noexcept { return static_cast<unsigned>(std::bit_width(bits)) - 1; }

}  // namespace

/// Cache misses dominate the time of a query that runs once a millisecond. Therefore the traversal processes up to
/// kBatch nodes of one level and prefetches all their children. A leaf takes longer, so only kLeavesAhead leaves are
/// prefetched.
template <class Visit>
void AbTree::for_each_near_leaf(const Vec3d& point, double radius, Visit&& visit) const noexcept {
  if (root_ == kNone) return;
  const FloatPoint p{point};
  const float squared_radius = p.squared(radius);
  constexpr std::uint32_t kBatch = 32, kLeavesAhead = 8;
  struct Range {
    std::uint32_t begin = 0, end = 0;  // in `queue`
  };
  std::array<Range, kMaxHeight + 1> waiting{};  // nodes to process, by level; each range follows those of higher levels
  std::array<NodeIndex, 1 + TreeNode::kWidth * kBatch*(kMaxHeight - 1)> queue;
  queue[0] = root_;
  waiting[height_].end = 1;
  for (std::uint32_t level = height_; level <= height_;) {
    Range& here = waiting[level];
    if (level == 1) {
      for (; here.begin < here.end; ++here.begin) {
        if (here.begin + kLeavesAhead < here.end) prefetch_triangles(queue[here.begin + kLeavesAhead]);
        const NodeIndex number = queue[here.begin];
        const TreeNode& node = nodes_[number];
        const unsigned near = lanes::kBestKernels.triangles_within(node.lanes.data(), p.at, squared_radius);
        if (near != 0) visit(number, node, near);
      }
    }
    if (here.begin == here.end) {
      ++level;
      continue;
    }
    std::uint32_t queue_end = here.end;
    Range& below = waiting[--level];
    below.begin = queue_end;
    for (const std::uint32_t end = std::min(here.end, here.begin + kBatch); here.begin < end; ++here.begin) {
      const TreeNode& node = nodes_[queue[here.begin]];
      for (unsigned hit = lanes::kBestKernels.boxes_within(node.lanes.data(), p.at, squared_radius); hit != 0;
           hit &= hit - 1) {
        const NodeIndex child = node.node(std::countr_zero(hit));
        if (level > 1) {
          prefetch_children(child);
        } else if (queue_end < below.begin + kLeavesAhead) {
          prefetch_triangles(child);
        }
        queue[queue_end++] = child;
      }
    }
    below.end = queue_end;
  }
}

std::uint32_t AbTree::find_contacts(const Vec3d& centre, double radius, Contact* out,
                                    std::uint32_t capacity) const noexcept {
  const std::array<double, 3> p{centre[0], centre[1], centre[2]};
  std::array<Contact, TreeNode::kWidth> buffer;
  std::uint32_t count = 0;
  for_each_near_leaf(centre, radius, [&](NodeIndex number, const TreeNode& node, unsigned near) {
    const bool has_space = std::uint64_t{count} + TreeNode::kWidth <= capacity;
    Contact* at = has_space ? out + count : buffer.data();
    const std::uint32_t found =
        lanes::kBestKernels.touches({node.lanes.data(), node.face(0), number, node.finest}, p, near, radius, at);
    if (!has_space && count < capacity) std::copy_n(at, std::min(found, capacity - count), out + count);
    count += found;
  });
  return count;
}

void AbTree::fill(CandidateCache& cache, double radius, bool previous) const noexcept {
  cache.mesh = mesh(previous);
  cache.reach = radius;
  cache.is_truncated = false;
  cache.count = 0;
  const FloatPoint p{cache.centre};
  const auto add_leaf = [&](const TreeNode& node, unsigned near) noexcept {
    lanes::Closest closest;
    lanes::kBestKernels.closest_points(node.lanes.data(), p.exact, near, closest);
    double nearest = radius * radius;
    unsigned lanes_within = 0;
    for (unsigned lane = 0; lane < TreeNode::kWidth; ++lane) {
      if (!(closest.squared_distance[lane] <= radius * radius)) continue;
      lanes_within |= 1u << lane;
      nearest = std::min(nearest, closest.squared_distance[lane]);
    }
    if (lanes_within == 0) return;
    if (cache.count < CandidateCache::kMaxLeaves)
      cache.leaves[cache.count++] = {&node, std::sqrt(nearest), lanes_within};
    else
      cache.is_truncated = true;
  };
  for_each_near_leaf(cache.centre, radius, [&](NodeIndex, const TreeNode& node, unsigned near) {
    if (!previous || node.previous_number != previous_number_) add_leaf(node, near);
  });
  if (!previous) return;
  for_each_previous([&](const TreeNode& node) {
    const unsigned near = lanes::kBestKernels.triangles_within(node.lanes.data(), p.at, p.squared(radius));
    if (near != 0) add_leaf(node, near);
  });
}

const CandidateCache* AbTree::find_or_fill(const Vec3d& centre, double radius, bool previous, double slack,
                                           CandidateCaches& caches) const noexcept {
  constexpr double kWorthwhile = CandidateCache::kLayer / 4;
  const CandidateCache* found = caches.find_and_mark_used(mesh(previous), centre, radius * (1 + kWorthwhile) + slack);
  if (found == nullptr) {
    CandidateCache& oldest = caches.replace();
    oldest.centre = centre;
    fill(oldest, radius * (1 + CandidateCache::kLayer) + slack, previous);
    found = &oldest;
  }
  return found->is_truncated ? nullptr : found;
}

bool AbTree::sweep(const Vec3d& from, const Vec3d& to, double radius, SweepContact& first, Version version,
                   CandidateCaches* caches) const noexcept {
  const bool previous = version == Version::kPrevious && previous_differs();
  const Vec3d motion = to - from;
  const double length = motion.norm();
  if (!(length > 0) || (root_ == kNone && !previous)) return false;
  const double max = std::max(from.cwiseAbs().maxCoeff(), to.cwiseAbs().maxCoeff());
  const double slack = 4e-7 * max + 1e-6 * radius;
  const lanes::Sweep swept{
      {from[0], from[1], from[2]}, {motion[0], motion[1], motion[2]}, radius, length, max + radius};
  lanes::SweepBounds bounds;
  bool found = false;
  double limit = 1;
  // Limits the search to contacts up to `time`.
  const auto shorten = [&](double time) noexcept {
    limit = time;
    const double grown = radius + slack;
    const Vec3d end = from + time * motion;
    const FloatPoint middle{(from + end) / 2};
    bounds.middle = middle.at;
    bounds.squared_reach = middle.squared(radius + time * length / 2);
    double behind = 0;
    for (int axis = 0; axis < 3; ++axis) {
      bounds.low[axis] = static_cast<float>(std::min(from[axis], end[axis]) - grown);
      bounds.high[axis] = static_cast<float>(std::max(from[axis], end[axis]) + grown);
      bounds.direction[axis] = static_cast<float>(motion[axis] / length);
      behind += double{bounds.direction[axis]} * from[axis];
    }
    bounds.behind = static_cast<float>(behind - 4 * slack);
  };
  // Looks for an earlier contact with the triangles of a leaf whose bits are in `mask`.
  const auto offer = [&](const TreeNode& node, unsigned mask) noexcept {
    const unsigned near = lanes::kBestKernels.triangles_on_path(node.lanes.data(), bounds) & mask;
    if (near == 0) return;
    lanes::Doubles earliest;
    unsigned left = lanes::kBestKernels.sweep_candidates(node.lanes.data(), swept, near, limit, earliest);
    while (left != 0) {
      auto i = static_cast<unsigned>(std::countr_zero(left));  // most often this is the earliest triangle
      for (unsigned others = left & (left - 1); others != 0; others &= others - 1)
        if (earliest[std::countr_zero(others)] < earliest[i]) i = std::countr_zero(others);
      if (earliest[i] > limit) return;
      left &= ~(1u << i);
      SweepHit touch;
      if (!swept_sphere(from, to, radius, corner(node, i, 0), corner(node, i, 1), corner(node, i, 2), touch)) continue;
      const FaceId face = node.face(i);
      if (found && !(touch.time < first.time || (touch.time == first.time && face < first.face))) continue;
      found = true;
      first = {face, touch.time, touch.point, touch.normal};
      shorten(std::min(limit, touch.time));
    }
  };
  // Searches the whole tree for contacts up to `time`.
  const auto search = [&](double time) noexcept {
    shorten(time);
    std::array<NodeIndex, kStack> stack;
    int depth = 0;
    if (root_ != kNone) stack[depth++] = root_;
    while (depth > 0) {
      const TreeNode& node = nodes_[stack[--depth]];
      if (node.level == 1) {
        if (!previous || node.previous_number != previous_number_) offer(node, lanes::kAllLanes);
        continue;
      }
      for (unsigned hit = lanes::kBestKernels.boxes_on_path(node.lanes.data(), bounds); hit != 0;
           hit &= ~(1u << highest_bit(hit)))
        stack[depth++] = node.node(highest_bit(hit));
    }
    if (previous) for_each_previous([&](const TreeNode& node) { offer(node, lanes::kAllLanes); });
  };
  // A proxy at rest on a surface has a contact at once. The search therefore covers a short part of the motion first,
  // and then repeatedly a part that is kGrowth times as long, at most five times.
  constexpr double kAtOnce = 0.002, kNear = 0.01;   // length of the first part, in radii: in a cache; in the tree
  constexpr double kGrowth = 4, kMin = 1.0 / 1024;  // kMin: min length of the first part, as a share of the motion
  double time = radius > 0 ? std::clamp(kNear * radius / length, kMin, 1.0) : 1;
  if (const CandidateCache* cache =
          radius > 0 && caches != nullptr ? find_or_fill(from, radius, previous, slack, *caches) : nullptr;
      cache != nullptr) {
    const double moved = (from - cache->centre).norm() + radius + slack;
    const double covered = std::min(1.0, (cache->reach - moved) / length);
    for (const double until : {std::min(covered, kAtOnce * radius / length), covered}) {
      shorten(found ? first.time : until);
      for (std::uint32_t i = 0; i < cache->count; ++i)
        if (cache->leaves[i].distance <= moved + limit * length) offer(*cache->leaves[i].node, cache->leaves[i].lanes);
      if ((found && first.time <= until) || until >= 1) return found;
    }
    time = std::clamp(kGrowth * covered, kMin, 1.0);
  }
  for (;; time = std::min(1.0, kGrowth * time)) {
    search(found ? std::min(time, first.time) : time);
    if ((found && first.time <= time) || time >= 1) return found;
  }
}

std::uint32_t AbTree::nearest(const Vec3d& point, double max_distance, double margin, NearestFace& best,
                              LeafLane* leaf_lanes, std::uint32_t capacity,
                              const CandidateCaches* caches) const noexcept {
  if (root_ == kNone) return 0;
  const FloatPoint p{point};
  best.squared_distance = max_distance * max_distance;
  double reach = max_distance + margin;
  double squared_reach = reach * reach;
  float squared_limit = p.squared(reach);
  struct Near {
    FaceId face;
    NodeIndex leaf;
    double squared;
  };
  std::array<Near, kMaxNearest> near_faces;
  std::uint32_t near_count = 0;
  capacity = std::min(capacity, kMaxNearest);
  // Drops the faces that are no longer within the margin.
  const auto drop_far = [&]() noexcept {
    std::uint32_t remaining = 0;
    for (std::uint32_t i = 0; i < near_count; ++i)
      if (near_faces[i].squared <= squared_reach) near_faces[remaining++] = near_faces[i];
    near_count = remaining;
  };
  bool found = false;
  const auto offer = [&](const TreeNode& node) noexcept {
    const unsigned near = lanes::kBestKernels.triangles_within(node.lanes.data(), p.at, squared_limit);
    if (near == 0) return;
    lanes::Closest closest;
    lanes::kBestKernels.closest_points(node.lanes.data(), p.exact, near, closest);
    for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
      const double squared = closest.squared_distance[i];
      if (!(squared <= squared_reach)) continue;
      const FaceId face = node.face(i);
      const bool nearer =
          squared < best.squared_distance || (squared == best.squared_distance && (!found || face < best.face));
      if (nearer) {
        found = true;
        best = {face, {closest.point[0][i], closest.point[1][i], closest.point[2][i]}, squared};
        reach = std::sqrt(squared) + margin;
        squared_reach = std::max(squared, reach * reach);
        squared_limit = p.squared(reach);
      }
      if (capacity == 0) continue;
      if (near_count == capacity) drop_far();
      if (near_count < capacity) near_faces[near_count++] = {face, nodes_.index_of(node), squared};
    }
  };
  const auto search = [&]() noexcept {
    struct Entry {
      NodeIndex node;
      float squared;
    };
    std::array<Entry, kStack> stack;
    int depth = 0;
    stack[depth++] = {root_, 0};
    while (depth > 0) {
      const Entry entry = stack[--depth];
      if (entry.squared > squared_limit) continue;
      const TreeNode& node = nodes_[entry.node];
      if (node.level == 1) {
        offer(node);
        continue;
      }
      lanes::Floats squared;
      lanes::kBestKernels.box_distances(node.lanes.data(), p.at, squared);
      const int first = depth;
      for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
        if (!(squared[i] <= squared_limit)) continue;
        int at = depth++;  // inserts the farthest child first, so that the nearest is popped first
        for (; at > first && stack[at - 1].squared < squared[i]; --at) stack[at] = stack[at - 1];
        stack[at] = {node.node(i), squared[i]};
        prefetch_triangles(node.node(i));
      }
    }
  };
  const CandidateCache* cache =
      caches != nullptr ? caches->find(mesh(false), point, max_distance + margin + p.slack) : nullptr;
  if (cache == nullptr || cache->is_truncated) {
    search();
  } else {
    const double moved = (point - cache->centre).norm() + p.slack;
    for (std::uint32_t i = 0; i < cache->count; ++i)
      if (cache->leaves[i].distance <= moved + reach) offer(*cache->leaves[i].node);
  }
  if (!found) return 0;
  drop_far();
  std::sort(near_faces.begin(), near_faces.begin() + near_count,
            [](const Near& a, const Near& b) { return a.face < b.face; });
  for (std::uint32_t i = 0; i < near_count; ++i)
    leaf_lanes[i] = LeafLane{near_faces[i].leaf, lane_of(near_faces[i].face)};
  return std::max(1u, near_count);
}

}  // namespace tactus::spm
