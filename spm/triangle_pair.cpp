#include "spm/triangle_pair.hpp"

#include <Eigen/Geometry>
#include <bit>
#include <cmath>
#include <limits>

#include "spm/orientation.hpp"

namespace tactus::spm {
namespace {

// Triangle F (object) has the edges f_i f_i+1, triangle G (probe) the edges g_j g_j+1. An edge of F pierces G if its
// end points are on both sides of the plane of G and its line passes all three edges of G on the same side. The same
// holds for an edge of G. The test therefore needs the sides of 3 + 3 corners and of 3 x 3 pairs of edges:
//
//   side_f[i] = (g0 g1 g2 f_i)    side_g[j] = (f0 f1 f2 g_j)    pass[i][j] = (f_i f_i+1 g_j g_j+1)
//
// where (a b c d) is the sign of (b - a) x (c - a) . (d - a). A zero counts as either sign. If two triangles intersect
// and are not coplanar, an edge pierces.

using Sides = std::array<int, 3>;

struct Signs {
  Sides side_f, side_g;
  std::array<Sides, 3> pass;
};

bool all_strictly_one_side(const Sides& s) noexcept { return s[0] * s[1] > 0 && s[1] * s[2] > 0; }
bool all_zero(const Sides& s) noexcept { return s[0] == 0 && s[1] == 0 && s[2] == 0; }
bool no_two_opposite(int a, int b, int c) noexcept { return a * b >= 0 && b * c >= 0 && c * a >= 0; }

/// Returns the share of a segment before a plane. The end points are on both sides, at the distances |a| and |b|.
double crossing(double a, double b) noexcept {
  const double total = std::abs(a) + std::abs(b);
  return total > 0 ? std::abs(a) / total : 0.5;
}

double volume(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d) noexcept {
  return (b - a).cross(c - a).dot(d - a);
}

/// Sum and number of points, for their mean.
struct Mean {
  Vec3d sum = Vec3d::Zero();
  int count = 0;
  void add(const Vec3d& p) noexcept {
    sum += p;
    ++count;
  }
};

/// Adds the points where edges of `a` pierce `b`; `passes(i, j)` is the side on which edge i of a passes edge j of b.
template <class Passes>
void add_piercings(const Triangle3d& a, const Triangle3d& b, const Sides& side, const Passes& passes,
                   Mean& points) noexcept {
  for (int i = 0; i < 3; ++i) {
    const int next = (i + 1) % 3;
    if (side[i] * side[next] > 0 || (side[i] == 0 && side[next] == 0)) continue;
    if (!no_two_opposite(passes(i, 0), passes(i, 1), passes(i, 2))) continue;
    const double from = side[i] == 0 ? 0 : volume(b[0], b[1], b[2], a[i]);
    const double to = side[next] == 0 ? 0 : volume(b[0], b[1], b[2], a[next]);
    points.add(a[i] + crossing(from, to) * (a[next] - a[i]));
  }
}

/// Decides for coplanar triangles. Projects them along an axis such that both have an area. They are disjoint if an
/// edge of one has the other triangle strictly on its outer side.
bool intersect_in_plane(const Triangle3d& f, const Triangle3d& g, Vec3d& point) noexcept {
  int x = 0, y = 1, area_f = 0, area_g = 0;
  for (int dropped = 0; dropped < 3 && (area_f == 0 || area_g == 0); ++dropped) {
    x = (dropped + 1) % 3;
    y = (dropped + 2) % 3;
    area_f = orientation(f[0], f[1], f[2], x, y);
    area_g = orientation(g[0], g[1], g[2], x, y);
  }
  if (area_f == 0 || area_g == 0) return false;
  std::array<Sides, 3> f_of_g, g_of_f;  // f_of_g[corner of F][edge of G] and the reverse: positive inside
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      f_of_g[i][j] = area_g * orientation(g[j], g[(j + 1) % 3], f[i], x, y);
      g_of_f[i][j] = area_f * orientation(f[j], f[(j + 1) % 3], g[i], x, y);
    }
  for (int j = 0; j < 3; ++j) {
    if (f_of_g[0][j] < 0 && f_of_g[1][j] < 0 && f_of_g[2][j] < 0) return false;
    if (g_of_f[0][j] < 0 && g_of_f[1][j] < 0 && g_of_f[2][j] < 0) return false;
  }
  Mean points;
  const auto area = [x, y](const Vec3d& a, const Vec3d& b, const Vec3d& c) noexcept {
    return (b[x] - a[x]) * (c[y] - a[y]) - (b[y] - a[y]) * (c[x] - a[x]);
  };
  for (int i = 0; i < 3; ++i) {
    const int next = (i + 1) % 3;
    if (f_of_g[i][0] >= 0 && f_of_g[i][1] >= 0 && f_of_g[i][2] >= 0) points.add(f[i]);
    if (g_of_f[i][0] >= 0 && g_of_f[i][1] >= 0 && g_of_f[i][2] >= 0) points.add(g[i]);
    for (int j = 0; j < 3; ++j) {
      const int after = (j + 1) % 3;
      if (f_of_g[i][j] * f_of_g[next][j] >= 0 || g_of_f[j][i] * g_of_f[after][i] >= 0) continue;
      const double at = crossing(area(g[j], g[after], f[i]), area(g[j], g[after], f[next]));
      points.add(f[i] + at * (f[next] - f[i]));
    }
  }
  if (points.count == 0) return false;
  point = points.sum / points.count;
  return true;
}

/// Decides exactly, for pairs for which rounding errors could change the decision.
[[gnu::noinline]] bool intersect_exactly(const Triangle3d& f, const Triangle3d& g, Vec3d& point) noexcept {
  Signs s;
  for (int i = 0; i < 3; ++i) s.side_f[i] = orientation(g[0], g[1], g[2], f[i]);
  if (all_strictly_one_side(s.side_f)) return false;
  for (int j = 0; j < 3; ++j) s.side_g[j] = orientation(f[0], f[1], f[2], g[j]);
  if (all_strictly_one_side(s.side_g)) return false;
  if (all_zero(s.side_f) || all_zero(s.side_g))  // the triangles have a common plane, or one has no area
    return all_zero(s.side_f) && all_zero(s.side_g) && intersect_in_plane(f, g, point);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) s.pass[i][j] = orientation(f[i], f[(i + 1) % 3], g[j], g[(j + 1) % 3]);
  Mean points;
  add_piercings(
      f, g, s.side_f, [&s](int i, int j) noexcept { return s.pass[i][j]; }, points);
  add_piercings(
      g, f, s.side_g, [&s](int i, int j) noexcept { return s.pass[j][i]; }, points);
  if (points.count == 0) return false;
  point = points.sum / points.count;
  return true;
}

constexpr double kFar = std::numeric_limits<double>::infinity();

struct BatchMasks {
  unsigned intersecting, unsure;
};

namespace base {
constexpr int kDoubles = 2;
#include "spm/triangle_pair_kernel.inc"
}  // namespace base
#ifdef TACTUS_HAS_TARGETS
TACTUS_TARGET_AVX2
namespace avx2 {
constexpr int kDoubles = 4;
#include "spm/triangle_pair_kernel.inc"  // NOLINT(readability-duplicate-include): for each instruction set
}  // namespace avx2
TACTUS_TARGET_END
TACTUS_TARGET_AVX512
namespace avx512 {
constexpr int kDoubles = 8;
#include "spm/triangle_pair_kernel.inc"  // NOLINT(readability-duplicate-include): for each instruction set
}  // namespace avx512
TACTUS_TARGET_END
#endif

BatchMasks intersect_kernel(const TrianglePairs& pairs, unsigned count, PairContacts& out, Simd simd) noexcept {
#ifdef TACTUS_HAS_TARGETS
  if (simd == Simd::kAvx512) return avx512::intersect(pairs, count, out);
  if (simd == Simd::kAvx2) return avx2::intersect(pairs, count, out);
#endif
  static_cast<void>(simd);
  return base::intersect(pairs, count, out);
}

Triangle3d lane_of(const double (&corners)[3][3][TrianglePairs::kWidth], unsigned lane) noexcept {
  Triangle3d triangle;
  for (int corner = 0; corner < 3; ++corner)
    for (int axis = 0; axis < 3; ++axis) triangle[corner][axis] = corners[corner][axis][lane];
  return triangle;
}

}  // namespace

unsigned intersect(const TrianglePairs& pairs, unsigned count, PairContacts& out, Simd simd) noexcept {
  BatchMasks masks = intersect_kernel(pairs, count, out, simd);
  const unsigned requested = (1u << count) - 1;
  masks.intersecting &= requested;
  for (unsigned left = masks.unsure & requested; left != 0; left &= left - 1) {
    const auto lane = static_cast<unsigned>(std::countr_zero(left));
    Vec3d point;
    if (!intersect_exactly(lane_of(pairs.object, lane), lane_of(pairs.probe, lane), point)) continue;
    masks.intersecting |= 1u << lane;
    for (int axis = 0; axis < 3; ++axis) out.point[axis][lane] = point[axis];
  }
  for (unsigned left = masks.intersecting; left != 0; left &= left - 1) {
    const auto lane = static_cast<unsigned>(std::countr_zero(left));
    const Vec3d scaled_normal{out.normal[0][lane], out.normal[1][lane], out.normal[2][lane]};
    const double length = scaled_normal.norm();
    // If the corners are collinear up to rounding, there is no normal, so any is returned.
    const Vec3d normal = length > 0 ? Vec3d{scaled_normal / length} : Vec3d::UnitZ();
    for (int axis = 0; axis < 3; ++axis) out.normal[axis][lane] = normal[axis];
    const double lowest = length > 0 ? out.depth[lane] / length : 0;
    out.depth[lane] = lowest < 0 ? -lowest : 0;
  }
  return masks.intersecting;
}

bool intersect(const Triangle3d& object, const Triangle3d& probe, PairContact& contact) noexcept {
  TrianglePairs pairs;
  for (int corner = 0; corner < 3; ++corner)
    for (int axis = 0; axis < 3; ++axis)
      for (int lane = 0; lane < TrianglePairs::kWidth; ++lane) {
        pairs.object[corner][axis][lane] = object[corner][axis];
        pairs.probe[corner][axis][lane] = probe[corner][axis];
      }
  PairContacts found;
  if (intersect(pairs, 1, found, Simd::kBase) == 0) return false;
  for (int axis = 0; axis < 3; ++axis) {
    contact.point[axis] = found.point[axis][0];
    contact.normal[axis] = found.normal[axis][0];
  }
  contact.depth = found.depth[0];
  return true;
}

}  // namespace tactus::spm
