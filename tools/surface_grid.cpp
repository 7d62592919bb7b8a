#include "tools/surface_grid.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace tactus::tools {
namespace {

using Real = long double;
using Vector = std::array<Real, 3>;

Real dot(const Vector& a, const Vector& b) noexcept { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/// Returns |q - s a - t b|^2.
Real squared_residual(const Vector& q, const Vector& a, Real s, const Vector& b, Real t) noexcept {
  Real sum = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const Real residual = q[axis] - s * a[axis] - t * b[axis];
    sum += residual * residual;
  }
  return sum;
}

/// Returns the squared distance of q from the segment between the origin and `end`.
Real squared_from_segment(const Vector& q, const Vector& end) noexcept {
  const Real length2 = dot(end, end);
  const Real along = length2 > 0 ? std::clamp<Real>(dot(q, end) / length2, 0, 1) : 0;
  return squared_residual(q, end, along, end, 0);
}

// 4^10 = 2^20: the cell of the last level is as wide as kMaxCells cells of the first level.
constexpr int kLevels = 11;
constexpr double kLevelStep = 4;
constexpr double kMaxCells = 1u << 20;
constexpr double kSlack = 1e-6;  // tolerance for rounding, in cells

std::uint64_t cell_key(std::uint64_t level, std::uint64_t x, std::uint64_t y, std::uint64_t z) noexcept {
  return level << 60 | x << 40 | y << 20 | z;
}

}  // namespace

double distance_to_triangle(const Point& point, const Corners& triangle) noexcept {
  Vector q, ab, ac, bc, from_b;
  for (int axis = 0; axis < 3; ++axis) {
    const Real a = triangle[axis], b = triangle[3 + axis], c = triangle[6 + axis], p = point[axis];
    q[axis] = p - a;
    ab[axis] = b - a;
    ac[axis] = c - a;
    bc[axis] = c - b;
    from_b[axis] = p - b;
  }
  Real best = std::min({squared_from_segment(q, ab), squared_from_segment(q, ac), squared_from_segment(from_b, bc)});
  // q = s ab + t ac + r, with r perpendicular to both:  | ab.ab  ab.ac | |s|   | ab.q |
  //                                                     | ab.ac  ac.ac | |t| = | ac.q |
  const Real aa = dot(ab, ab), bb = dot(ac, ac), mixed = dot(ab, ac), right_a = dot(ab, q), right_b = dot(ac, q);
  const Real determinant = aa * bb - mixed * mixed;
  if (determinant > 0) {
    const Real s = (right_a * bb - right_b * mixed) / determinant;
    const Real t = (right_b * aa - right_a * mixed) / determinant;
    if (s >= 0 && t >= 0 && s + t <= 1) best = std::min(best, squared_residual(q, ab, s, ac, t));
  }
  return static_cast<double>(std::sqrt(best));
}

SurfaceGrid::Box SurfaceGrid::box_of(const Corners& triangle) noexcept {
  Box box;
  for (int axis = 0; axis < 3; ++axis) {
    const auto [low, high] = std::minmax({triangle[axis], triangle[3 + axis], triangle[6 + axis]});
    box.low[axis] = low;
    box.high[axis] = high;
  }
  return box;
}

SurfaceGrid::SurfaceGrid(const std::vector<Corners>& triangles, double reach) : triangles_{triangles} {
  if (triangles.empty()) return;
  low_.fill(std::numeric_limits<double>::infinity());
  Point high;
  high.fill(-std::numeric_limits<double>::infinity());
  for (const Corners& triangle : triangles) {
    const Box box = box_of(triangle);
    for (int axis = 0; axis < 3; ++axis) {
      low_[axis] = std::min(low_[axis], box.low[axis]);
      high[axis] = std::max(high[axis], box.high[axis]);
    }
  }
  const double longest = std::max({high[0] - low_[0], high[1] - low_[1], high[2] - low_[2]});
  levels_.resize(kLevels);
  double cell = std::max(reach, longest * 1.001 / kMaxCells);
  for (Level& level : levels_) {
    level.cell_size = cell;
    for (int axis = 0; axis < 3; ++axis)
      level.last[axis] = static_cast<std::uint32_t>(std::floor((high[axis] - low_[axis]) / cell));
    cell *= kLevelStep;
  }

  std::vector<std::uint64_t> key_of(triangles.size());
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const Box box = box_of(triangles[i]);
    const double width = std::max({box.high[0] - box.low[0], box.high[1] - box.low[1], box.high[2] - box.low[2]});
    std::uint64_t level = 0;
    while (levels_[level].cell_size < width) ++level;
    std::array<std::uint64_t, 3> at;
    for (int axis = 0; axis < 3; ++axis)
      at[axis] = static_cast<std::uint64_t>(std::floor((box.low[axis] - low_[axis]) / levels_[level].cell_size));
    key_of[i] = cell_key(level, at[0], at[1], at[2]);
  }
  order_.resize(triangles.size());
  std::iota(order_.begin(), order_.end(), 0u);
  std::stable_sort(order_.begin(), order_.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return key_of[a] < key_of[b]; });
  keys_.reserve(order_.size());
  for (const std::uint32_t triangle : order_) {
    const std::uint64_t key = key_of[triangle];
    levels_[key >> 60].first.try_emplace(key, static_cast<std::uint32_t>(keys_.size()));
    keys_.push_back(key);
  }
}

template <class Visit>
void SurfaceGrid::search(const Point& point, double distance, Visit&& visit) const {
  for (std::size_t number = 0; number < levels_.size(); ++number) {
    const Level& level = levels_[number];
    if (level.first.empty()) continue;
    std::array<std::uint64_t, 3> from, to;
    bool outside = false;
    for (int axis = 0; axis < 3; ++axis) {
      // A triangle extends at most one cell beyond the cell of its box's low corner.
      const double low = std::floor((point[axis] - distance - low_[axis]) / level.cell_size - kSlack) - 1;
      const double high = std::floor((point[axis] + distance - low_[axis]) / level.cell_size + kSlack);
      if (!(low <= level.last[axis] && high >= 0)) {
        outside = true;
        break;
      }
      from[axis] = static_cast<std::uint64_t>(std::max(low, 0.0));
      to[axis] = static_cast<std::uint64_t>(std::min<double>(high, level.last[axis]));
    }
    if (outside) continue;
    for (std::uint64_t x = from[0]; x <= to[0]; ++x)
      for (std::uint64_t y = from[1]; y <= to[1]; ++y)
        for (std::uint64_t z = from[2]; z <= to[2]; ++z) {
          const std::uint64_t key = cell_key(number, x, y, z);
          const auto cell = level.first.find(key);
          if (cell == level.first.end()) continue;
          for (std::size_t i = cell->second; i < keys_.size() && keys_[i] == key; ++i) {
            const Corners& triangle = triangles_[order_[i]];
            const Box box = box_of(triangle);
            bool far = false;
            for (int axis = 0; axis < 3; ++axis)
              far = far || box.low[axis] - point[axis] > distance || point[axis] - box.high[axis] > distance;
            if (far) continue;
            const double found = distance_to_triangle(point, triangle);
            if (found <= distance && visit(order_[i], found)) return;
          }
        }
  }
}

void SurfaceGrid::within(const Point& point, double distance, std::vector<Near>& out) const {
  out.clear();
  search(point, distance, [&](std::uint32_t triangle, double found) {
    out.push_back({triangle, found});
    return false;
  });
  std::sort(out.begin(), out.end(), [](const Near& a, const Near& b) { return a.triangle < b.triangle; });
}

bool SurfaceGrid::touches(const Point& point, double distance) const {
  bool any = false;
  search(point, distance, [&](std::uint32_t, double) { return any = true; });
  return any;
}

}  // namespace tactus::tools
