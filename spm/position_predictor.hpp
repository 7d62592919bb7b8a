/// Where a split's vertex is expected, by the vertices around it, so that its place takes few bits to tell.
///
///     two axes    the mean of the ring, a little towards t and away from the ring's ends: a collapse goes along a
///     short
///                 edge. The two that lie flattest in the surface are told first
///     the third   on the plane through that place as flat as the ring is, where the other two have come to stand: what
///                 is left to tell is how far the vertex stands out of the surface
///
/// Sender and receiver compute the same to the bit: doubles, one order of vertices, no contraction.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "spm/model.hpp"
#include "spm/position_code.hpp"
#include "spm/vertex_ring.hpp"

namespace tactus::spm {

class PositionPredictor {
 public:
  /// Differences in PositionCodes: along the surface twice, then across it. They wrap.
  using Residuals = std::array<std::uint32_t, 3>;

  /// Not for an empty ring. `position_of(vertex)` gives three floats within the bounds. O(ring).
  template <class PositionOf>
  PositionPredictor(const ModelSummary& summary, const VertexRing& ring, PositionOf position_of) noexcept
      : summary_{summary}, code_{summary} {
    const std::uint32_t count = ring.size();
    // From t: the first of the others, the one before, the sum.
    const Point t = point(position_of(ring[0]));
    Point first{}, before{}, sum{}, normal{};
    for (std::uint32_t i = 1; i < count; ++i) {
      const Point p = point(position_of(ring[i]));
      const Point at{p[0] - t[0], p[1] - t[1], p[2] - t[2]};
      if (i == 1) first = at;
      sum = {sum[0] + at[0], sum[1] + at[1], sum[2] + at[2]};
      normal[0] += before[1] * at[2] - before[2] * at[1];
      normal[1] += before[2] * at[0] - before[0] * at[2];
      normal[2] += before[0] * at[1] - before[1] * at[0];
      before = at;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const double mean = sum[k] / count;
      expected_[k] = t[k] + (mean - kTowardsParent * mean - kAwayFromEnds * ((first[k] + before[k]) / 2 - mean));
      if (std::abs(normal[k]) > std::abs(normal[across_])) across_ = k;
    }
    if (normal[across_] == 0) return;
    for (std::size_t k = 0; k < 3; ++k) slope_[k] = -normal[k] / normal[across_];
  }

  [[nodiscard]] Residuals residuals_to(const std::array<float, 3>& position) const noexcept {
    Residuals offsets{};
    const std::size_t a = after(across_), b = after(a);
    offsets[0] = code_.of(a, double{position[a]}) - code_of(a, expected_[a]);
    offsets[1] = code_.of(b, double{position[b]}) - code_of(b, expected_[b]);
    offsets[2] = code_.of(across_, double{position[across_]}) - code_of(across_, third(position));
    return offsets;
  }
  /// False when that is out of the bounds.
  [[nodiscard]] bool place(const Residuals& offsets, std::array<float, 3>& position) const noexcept {
    const std::size_t a = after(across_), b = after(a);
    position[a] = code_.at(a, code_of(a, expected_[a]) + offsets[0]);
    position[b] = code_.at(b, code_of(b, expected_[b]) + offsets[1]);
    if (!within(a, position[a]) || !within(b, position[b])) return false;
    position[across_] = code_.at(across_, code_of(across_, third(position)) + offsets[2]);
    return within(across_, position[across_]);
  }

 private:
  using Point = std::array<double, 3>;
  // Least squares over bunny, organ and dragon, rounded; the best for each is within a tenth of a bit of these.
  static constexpr double kTowardsParent = 0.25, kAwayFromEnds = 0.14;

  static std::size_t after(std::size_t axis) noexcept { return axis == 2 ? 0 : axis + 1; }
  static Point point(const std::array<float, 3>& p) noexcept { return {double{p[0]}, double{p[1]}, double{p[2]}}; }
  [[nodiscard]] double third(const std::array<float, 3>& position) const noexcept {
    const std::size_t a = after(across_), b = after(a);
    return expected_[across_] + slope_[a] * (double{position[a]} - expected_[a]) +
           slope_[b] * (double{position[b]} - expected_[b]);
  }
  [[nodiscard]] std::uint32_t code_of(std::size_t axis, double coordinate) const noexcept {
    return code_.of(axis, std::clamp(coordinate, double{summary_.bounds_min[axis]}, double{summary_.bounds_max[axis]}));
  }
  // Written so that a NaN fails.
  [[nodiscard]] bool within(std::size_t axis, float coordinate) const noexcept {
    return coordinate >= summary_.bounds_min[axis] && coordinate <= summary_.bounds_max[axis];
  }

  const ModelSummary& summary_;
  PositionCode code_;
  std::size_t across_ = 0;
  Point expected_{}, slope_{};
};

}  // namespace tactus::spm
