#include "spm/lanes.hpp"

#include <cstdint>
#include <cstring>
#include <limits>

// One version per instruction set, chosen when the program is loaded. Sanitizers instrument the chooser, which runs
// before they do; their builds take the baseline and so test it.
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && !defined(TACTUS_BASELINE_LANES)
#define TACTUS_LANES __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define TACTUS_LANES
#endif
// Vectors never cross a call: all that takes or gives one is inlined into the function that is cloned.
#define TACTUS_INLINE __attribute__((always_inline)) inline

namespace tactus::spm::lanes {
namespace {

using F = float __attribute__((vector_size(32)));
using I = std::int32_t __attribute__((vector_size(32)));
using F4 = float __attribute__((vector_size(16)));
using D = double __attribute__((vector_size(32)));
using M = std::int64_t __attribute__((vector_size(32)));
constexpr int kHalf = 4;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

TACTUS_INLINE F load(const Floats& from) noexcept {
  F to;
  std::memcpy(&to, from.data(), sizeof to);
  return to;
}
TACTUS_INLINE D load_double(const float* from) noexcept {
  F4 four;
  std::memcpy(&four, from, sizeof four);
  return __builtin_convertvector(four, D);
}

/// b where either is NaN.
template <class V>
TACTUS_INLINE V smaller(V a, V b) noexcept {
  return a < b ? a : b;
}
template <class V>
TACTUS_INLINE V larger(V a, V b) noexcept {
  return a > b ? a : b;
}

TACTUS_INLINE unsigned bits_of(I mask) noexcept {
  const I bits = mask & I{1, 2, 4, 8, 16, 32, 64, 128};
  std::uint64_t part[4];
  std::memcpy(part, &bits, sizeof part);
  const std::uint64_t all = part[0] | part[1] | part[2] | part[3];
  return static_cast<unsigned>(all | all >> 32);
}

TACTUS_INLINE F squared_distances(const Floats* boxes, const std::array<float, 3>& p) noexcept {
  F sum{};
  for (int axis = 0; axis < 3; ++axis) {
    const F d = larger(load(boxes[axis]) - p[axis], p[axis] - load(boxes[3 + axis]));
    const F outside = d < 0 ? F{} : d;  // NaN stays
    sum += outside * outside;
  }
  return sum;
}

/// The least lane; NaN counts as none.
TACTUS_INLINE float least_of(F v) noexcept {
  v = smaller(v, __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3));
  v = smaller(v, __builtin_shufflevector(v, v, 2, 3, 0, 1, 6, 7, 4, 5));
  v = smaller(v, __builtin_shufflevector(v, v, 1, 0, 3, 2, 5, 4, 7, 6));
  return v[0];
}

struct Triple {
  D x, y, z;
};
TACTUS_INLINE Triple operator-(const Triple& a, const Triple& b) noexcept { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
TACTUS_INLINE Triple operator+(const Triple& a, const Triple& b) noexcept { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
TACTUS_INLINE Triple operator*(const Triple& a, const D& s) noexcept { return {a.x * s, a.y * s, a.z * s}; }
TACTUS_INLINE D dot(const Triple& a, const Triple& b) noexcept { return a.x * b.x + a.y * b.y + a.z * b.z; }
TACTUS_INLINE Triple choose(const M& first, const Triple& a, const Triple& b) noexcept {
  return {first ? a.x : b.x, first ? a.y : b.y, first ? a.z : b.z};
}
TACTUS_INLINE Triple corner(const Floats* corners, int number, int lane) noexcept {
  return {load_double(corners[3 * number].data() + lane), load_double(corners[3 * number + 1].data() + lane),
          load_double(corners[3 * number + 2].data() + lane)};
}

struct Nearest {
  Triple point;
  D squared;
};

/// `along` is the dot product of the edge and p - a.
TACTUS_INLINE void try_segment(Nearest& best, const Triple& p, const Triple& a, const Triple& b, const Triple& edge,
                               const D& along, const D& length2) noexcept {
  const Triple point = choose(along > 0, choose(along < length2, a + edge * (along / length2), b), a);
  const Triple off = p - point;
  const D squared = dot(off, off);
  const M nearer = squared < best.squared;
  best = {choose(nearer, point, best.point), nearer ? squared : best.squared};
}

/// spm::closest_point for four lanes, without branches: every edge is tried.
TACTUS_INLINE void closest_of_half(const Floats* corners, const Triple& p, int lane, Closest& out) noexcept {
  constexpr double kFlat = 1e-28;
  const Triple a = corner(corners, 0, lane), b = corner(corners, 1, lane), c = corner(corners, 2, lane);
  const Triple ab = b - a, ac = c - a, bc = c - b, ca = a - c, ap = p - a;
  const D ab2 = dot(ab, ab), bc2 = dot(bc, bc), ca2 = dot(ca, ca);
  const D along = dot(ab, ap);
  const D slant = ab2 > 0 ? dot(ab, ac) / ab2 : D{};
  const Triple h = ac - ab * slant;
  const D h2 = dot(h, h);
  const D longest2 = larger(larger(ab2, bc2), ca2);
  const D s = along / ab2;
  const D w = dot(h, ap - ab * s) / h2;
  const D v = s - slant * w;
  const D u = 1 - v - w;
  const M inside = (ab2 * h2 > kFlat * longest2 * longest2) & (u >= 0) & (v >= 0) & (w >= 0);
  Nearest best;
  best.point = choose(inside, a + ab * s + h * w, a);
  const Triple off = p - best.point;
  best.squared = dot(off, off);
  try_segment(best, p, a, b, ab, along, ab2);
  try_segment(best, p, b, c, bc, dot(bc, p - b), bc2);
  try_segment(best, p, c, a, ca, dot(ca, p - c), ca2);
  std::memcpy(out.point[0].data() + lane, &best.point.x, sizeof(D));
  std::memcpy(out.point[1].data() + lane, &best.point.y, sizeof(D));
  std::memcpy(out.point[2].data() + lane, &best.point.z, sizeof(D));
  std::memcpy(out.squared_distance.data() + lane, &best.squared, sizeof(D));
}

}  // namespace

TACTUS_LANES void box_distances(const Floats* boxes, const std::array<float, 3>& p, Floats& squared) noexcept {
  const F all = squared_distances(boxes, p);
  std::memcpy(squared.data(), &all, sizeof all);
}

TACTUS_LANES unsigned boxes_within(const Floats* boxes, const std::array<float, 3>& p, float squared_radius) noexcept {
  return bits_of(squared_distances(boxes, p) <= squared_radius);
}

TACTUS_LANES unsigned boxes_meeting(const Floats* boxes, const std::array<float, 3>& low,
                                    const std::array<float, 3>& high) noexcept {
  I meets = load(boxes[0]) <= high[0];
  for (int axis = 0; axis < 3; ++axis)
    meets &= (load(boxes[axis]) <= high[axis]) & (load(boxes[3 + axis]) >= low[axis]);
  return bits_of(meets);
}

TACTUS_LANES Bounds bounds_of_boxes(const Floats* boxes) noexcept {
  Bounds bounds;
  const F none = F{} + kInfinity;
  for (int axis = 0; axis < 3; ++axis) {
    bounds.low[axis] = least_of(smaller(load(boxes[axis]), none));
    bounds.high[axis] = -least_of(smaller(-load(boxes[3 + axis]), none));
  }
  return bounds;
}

TACTUS_LANES Bounds bounds_of_triangles(const Floats* corners) noexcept {
  Bounds bounds;
  const F none = F{} + kInfinity;
  for (int axis = 0; axis < 3; ++axis) {
    const F a = load(corners[axis]), b = load(corners[3 + axis]), c = load(corners[6 + axis]);
    bounds.low[axis] = least_of(smaller(smaller(a, smaller(b, c)), none));
    bounds.high[axis] = -least_of(smaller(smaller(-a, smaller(-b, -c)), none));
  }
  return bounds;
}

TACTUS_LANES void closest_points(const Floats* corners, const std::array<double, 3>& centre, Closest& out) noexcept {
  const Triple p{D{} + centre[0], D{} + centre[1], D{} + centre[2]};
  for (int lane = 0; lane < kLanes; lane += kHalf) closest_of_half(corners, p, lane, out);
}

}  // namespace tactus::spm::lanes
