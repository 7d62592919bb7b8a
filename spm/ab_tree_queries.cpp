#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "spm/ab_tree.hpp"

namespace tactus::spm {
namespace {

/// The centre of a query in double and float, and the maximum error of a distance computed in float.
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

inline unsigned highest_bit(unsigned bits) noexcept { return static_cast<unsigned>(std::bit_width(bits)) - 1; }

}  // namespace

/// Cache misses dominate a query that runs once a millisecond. So the walk takes many nodes of one level together and
/// prefetches all their children. A leaf takes longer to process, so it prefetches only a few leaves ahead.
template <class Visit>
void AbTree::walk_near(const Vec3d& point, double radius, Visit&& visit) const noexcept {
  if (root_ == kNone) return;
  const FloatPoint p{point};
  const float squared_radius = p.squared(radius);
  constexpr std::uint32_t kTogether = 32, kLeavesAhead = 8;
  struct Waiting {
    std::uint32_t first = 0, last = 0;  // of `queue`
  };
  std::array<Waiting, kMaxHeight + 1> waiting{};  // by level, each after the levels above it
  std::array<NodeIndex, 1 + TreeNode::kWidth * kTogether*(kMaxHeight - 1)> queue;
  queue[0] = root_;
  waiting[height_].last = 1;
  for (std::uint32_t level = height_; level <= height_;) {
    Waiting& here = waiting[level];
    if (level == 1) {
      for (; here.first < here.last; ++here.first) {
        if (here.first + kLeavesAhead < here.last) prefetch_triangles(queue[here.first + kLeavesAhead]);
        const NodeIndex number = queue[here.first];
        const TreeNode& node = nodes_[number];
        const unsigned near = lanes::kBest.triangles_within(node.lanes.data(), p.at, squared_radius);
        if (near != 0) visit(number, node, near);
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
        const NodeIndex child = node.node(std::countr_zero(hit));
        if (level > 1) {
          prefetch_children(child);
        } else if (behind < below.first + kLeavesAhead) {
          prefetch_triangles(child);
        }
        queue[behind++] = child;
      }
    }
    below.last = behind;
  }
}

std::uint32_t AbTree::touching(const Vec3d& centre, double radius, Contact* out,
                               std::uint32_t capacity) const noexcept {
  const std::array<double, 3> p{centre[0], centre[1], centre[2]};
  std::array<Contact, TreeNode::kWidth> aside;
  std::uint32_t count = 0;
  walk_near(centre, radius, [&](NodeIndex number, const TreeNode& node, unsigned near) {
    const bool room = std::uint64_t{count} + TreeNode::kWidth <= capacity;
    Contact* at = room ? out + count : aside.data();
    const std::uint32_t found =
        lanes::kBest.touches({node.lanes.data(), node.face(0), number, node.last}, p, near, radius, at);
    if (!room && count < capacity) std::copy_n(at, std::min(found, capacity - count), out + count);
    count += found;
  });
  return count;
}

void AbTree::fill(CandidateCache& around, double within, bool kept) const noexcept {
  around.mesh = mesh(kept);
  around.reach = within;
  around.crowded = false;
  around.count = 0;
  const FloatPoint p{around.centre};
  const auto take = [&](const TreeNode& node, unsigned near) noexcept {
    lanes::Closest closest;
    lanes::kBest.closest_points(node.lanes.data(), p.exact, near, closest);
    double nearest = within * within;
    unsigned reached = 0;
    for (unsigned lane = 0; lane < TreeNode::kWidth; ++lane) {
      if (!(closest.squared_distance[lane] <= within * within)) continue;
      reached |= 1u << lane;
      nearest = std::min(nearest, closest.squared_distance[lane]);
    }
    if (reached == 0) return;
    if (around.count < CandidateCache::kMaxLeaves)
      around.leaves[around.count++] = {&node, std::sqrt(nearest), reached};
    else
      around.crowded = true;
  };
  walk_near(around.centre, within, [&](NodeIndex, const TreeNode& node, unsigned near) {
    if (!kept || node.kept != keeping_number_) take(node, near);
  });
  if (!kept) return;
  for_each_kept([&](const TreeNode& node) {
    const unsigned near = lanes::kBest.triangles_within(node.lanes.data(), p.at, p.squared(within));
    if (near != 0) take(node, near);
  });
}

const CandidateCache* AbTree::candidate_cache(const Vec3d& centre, double radius, bool kept, double slack,
                                              CandidateCaches& caches) const noexcept {
  constexpr double kWorthwhile = CandidateCache::kAround / 4;
  const CandidateCache* found = caches.use(mesh(kept), centre, radius * (1 + kWorthwhile) + slack);
  if (found == nullptr) {
    CandidateCache& oldest = caches.replace();
    oldest.centre = centre;
    fill(oldest, radius * (1 + CandidateCache::kAround) + slack, kept);
    found = &oldest;
  }
  return found->crowded ? nullptr : found;
}

bool AbTree::sweep(const Vec3d& from, const Vec3d& to, double radius, SweepContact& first, Version version,
                   CandidateCaches* caches) const noexcept {
  const bool kept = version == Version::kKept && kept_differs();
  const Vec3d motion = to - from;
  const double length = motion.norm();
  if (!(length > 0) || (root_ == kNone && !kept)) return false;
  const double max = std::max(from.cwiseAbs().maxCoeff(), to.cwiseAbs().maxCoeff());
  const double slack = 4e-7 * max + 1e-6 * radius;
  const lanes::Sweep swept{
      {from[0], from[1], from[2]}, {motion[0], motion[1], motion[2]}, radius, length, max + radius};
  lanes::Way way;
  bool found = false;
  double limit = 1;
  const auto shorten = [&](double time) noexcept {
    limit = time;
    const double grown = radius + slack;
    const Vec3d end = from + time * motion;
    const FloatPoint middle{(from + end) / 2};
    way.middle = middle.at;
    way.squared_reach = middle.squared(radius + time * length / 2);
    double behind = 0;
    for (int axis = 0; axis < 3; ++axis) {
      way.low[axis] = static_cast<float>(std::min(from[axis], end[axis]) - grown);
      way.high[axis] = static_cast<float>(std::max(from[axis], end[axis]) + grown);
      way.direction[axis] = static_cast<float>(motion[axis] / length);
      behind += double{way.direction[axis]} * from[axis];
    }
    way.behind = static_cast<float>(behind - 4 * slack);
  };
  const auto offer = [&](const TreeNode& node, unsigned wanted) noexcept {
    const unsigned near = lanes::kBest.triangles_on(node.lanes.data(), way) & wanted;
    if (near == 0) return;
    lanes::Doubles earliest;
    unsigned left = lanes::kBest.touched_by(node.lanes.data(), swept, near, limit, earliest);
    while (left != 0) {
      auto i = static_cast<unsigned>(std::countr_zero(left));  // most often this is the first one touched
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
  const auto search = [&](double time) noexcept {
    shorten(time);
    std::array<NodeIndex, kStack> stack;
    int depth = 0;
    if (root_ != kNone) stack[depth++] = root_;
    while (depth > 0) {
      const TreeNode& node = nodes_[stack[--depth]];
      if (node.level == 1) {
        if (!kept || node.kept != keeping_number_) offer(node, lanes::kAllLanes);
        continue;
      }
      for (unsigned hit = lanes::kBest.boxes_on(node.lanes.data(), way); hit != 0; hit &= ~(1u << highest_bit(hit)))
        stack[depth++] = node.node(highest_bit(hit));
    }
    if (kept) for_each_kept([&](const TreeNode& node) { offer(node, lanes::kAllLanes); });
  };
  // A proxy at rest on a surface hits it at once, so the search covers a short part of the motion first, then more.
  constexpr double kAtOnce = 0.002, kNear = 0.01;  // radii
  constexpr double kFurther = 4,
                   kMin = 1.0 / 1024;  // times the part before; of the whole motion. At most five more parts
  double time = radius > 0 ? std::clamp(kNear * radius / length, kMin, 1.0) : 1;
  if (const CandidateCache* around =
          radius > 0 && caches != nullptr ? candidate_cache(from, radius, kept, slack, *caches) : nullptr;
      around != nullptr) {
    const double moved = (from - around->centre).norm() + radius + slack;
    const double known = std::min(1.0, (around->reach - moved) / length);
    for (const double until : {std::min(known, kAtOnce * radius / length), known}) {
      shorten(found ? first.time : until);
      for (std::uint32_t i = 0; i < around->count; ++i)
        if (around->leaves[i].distance <= moved + limit * length)
          offer(*around->leaves[i].node, around->leaves[i].lanes);
      if ((found && first.time <= until) || until >= 1) return found;
    }
    time = std::clamp(kFurther * known, kMin, 1.0);
  }
  for (;; time = std::min(1.0, kFurther * time)) {
    search(found ? std::min(time, first.time) : time);
    if ((found && first.time <= time) || time >= 1) return found;
  }
}

std::uint32_t AbTree::nearest(const Vec3d& point, double within, double more, NearestFace& best, RowIndex* rows,
                              std::uint32_t capacity, const CandidateCaches* caches) const noexcept {
  if (root_ == kNone) return 0;
  const FloatPoint p{point};
  best.squared_distance = within * within;
  double reach = within + more;
  double squared_more = reach * reach;
  float squared_limit = p.squared(reach);
  struct Near {
    FaceId face;
    RowIndex row;
    double squared;
  };
  std::array<Near, kMaxNearest> near_faces;
  std::uint32_t near_count = 0;
  capacity = std::min(capacity, kMaxNearest);
  const auto drop_far = [&]() noexcept {
    std::uint32_t kept = 0;
    for (std::uint32_t i = 0; i < near_count; ++i)
      if (near_faces[i].squared <= squared_more) near_faces[kept++] = near_faces[i];
    near_count = kept;
  };
  bool found = false;
  const auto offer = [&](const TreeNode& node) noexcept {
    const unsigned near = lanes::kBest.triangles_within(node.lanes.data(), p.at, squared_limit);
    if (near == 0) return;
    lanes::Closest closest;
    lanes::kBest.closest_points(node.lanes.data(), p.exact, near, closest);
    for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
      const double squared = closest.squared_distance[i];
      if (!(squared <= squared_more)) continue;
      const FaceId face = node.face(i);
      const bool nearer =
          squared < best.squared_distance || (squared == best.squared_distance && (!found || face < best.face));
      if (nearer) {
        found = true;
        best = {face, {closest.point[0][i], closest.point[1][i], closest.point[2][i]}, squared, node.row(i)};
        reach = std::sqrt(squared) + more;
        squared_more = std::max(squared, reach * reach);
        squared_limit = p.squared(reach);
      }
      if (capacity == 0) continue;
      if (near_count == capacity) drop_far();
      if (near_count < capacity) near_faces[near_count++] = {face, node.row(i), squared};
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
      lanes::kBest.box_distances(node.lanes.data(), p.at, squared);
      const int first = depth;
      for (unsigned i = 0; i < TreeNode::kWidth; ++i) {
        if (!(squared[i] <= squared_limit)) continue;
        int place = depth++;  // the farthest first, so that the nearest is popped next
        for (; place > first && stack[place - 1].squared < squared[i]; --place) stack[place] = stack[place - 1];
        stack[place] = {node.node(i), squared[i]};
        prefetch(node.node(i));
      }
    }
  };
  const CandidateCache* around =
      caches != nullptr ? caches->find(mesh(false), point, within + more + p.slack) : nullptr;
  if (around == nullptr || around->crowded) {
    search();
  } else {
    const double moved = (point - around->centre).norm() + p.slack;
    for (std::uint32_t i = 0; i < around->count; ++i)
      if (around->leaves[i].distance <= moved + reach) offer(*around->leaves[i].node);
  }
  if (!found) return 0;
  drop_far();
  std::sort(near_faces.begin(), near_faces.begin() + near_count,
            [](const Near& a, const Near& b) { return a.face < b.face; });
  for (std::uint32_t i = 0; i < near_count; ++i) rows[i] = near_faces[i].row;
  return std::max(1u, near_count);
}

}  // namespace tactus::spm
