/// Predicts the position of a split's vertex from the vertices around it, so that a record only needs small residuals.
///
/// Two axes are predicted first: the mean of the ring, moved a little towards t and away from the ends of the ring,
/// because a collapse goes along a short edge. These are the two axes in which the surface is flattest. The third axis
/// follows from the plane of the ring through that position, after the residuals of the first two are applied; its
/// residual is the height above the surface.
///
/// Sender and receiver compute the same bits: doubles, a fixed order of vertices, no contraction.
/// Source: Touma, Gotsman 1998 (prediction and residual).
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
  /// Differences of PositionCodes: twice along the surface, then across it. They wrap.
  using Residuals = std::array<std::uint32_t, 3>;

  /// The ring must not be empty. `position_of(vertex)` gives three floats within the bounds. O(ring).
  template <class Vertex, class PositionOf>
  PositionPredictor(const ModelSummary& summary, const VertexRing<Vertex>& ring, PositionOf position_of) noexcept
      : summary_{summary}, code_{summary} {
    const std::uint32_t count = ring.size();
    // Relative to t: the first other vertex, the previous one, the sum.
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
  /// False if the position is out of the bounds.
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
  // Least squares over bunny, organ and dragon, rounded. The optimum of each saves at most a tenth of a bit.
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
  // False for NaN.
  [[nodiscard]] bool within(std::size_t axis, float coordinate) const noexcept {
    return coordinate >= summary_.bounds_min[axis] && coordinate <= summary_.bounds_max[axis];
  }

  const ModelSummary& summary_;
  PositionCode code_;
  std::size_t across_ = 0;
  Point expected_{}, slope_{};
};

}  // namespace tactus::spm
