/// Predicts the position of the vertex of a split from the vertices around it, so that a record needs only small
/// residuals.
///
/// The third axis is the coordinate axis closest to the normal of the ring. Along the two other axes, the predictor
/// starts at the mean of the ring. It moves this point a little towards the parent vertex t, because a collapse goes
/// along a short edge. It also moves the point away from the ends of the ring, its first and last vertex besides t.
/// After the residuals of these two axes are applied, the plane of the ring determines the expected coordinate along
/// the third axis. The residual of the third axis is therefore the height above the surface.
///
/// Sender and receiver compute the same bits, because both use doubles, the same order of vertices and no fused
/// multiply-add.
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
  /// Differences of position codes, modulo 2^32: two along the surface and one across it.
  using Residuals = std::array<std::uint32_t, 3>;

  /// The ring must not be empty. `position_of(vertex)` must return three floats within the bounds. O(ring).
  template <class Vertex, class PositionOf>
  PositionPredictor(const ModelSummary& summary, const VertexRing<Vertex>& ring, PositionOf position_of) noexcept
      : summary_{summary}, code_{summary} {
    const std::uint32_t count = ring.size();
    // Positions relative to t: `first` is the first vertex of the ring after t, `before` the vertex before `at`.
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
      if (std::abs(normal[k]) > std::abs(normal[third_])) third_ = k;
    }
    if (normal[third_] == 0) return;
    for (std::size_t k = 0; k < 3; ++k) slope_[k] = -normal[k] / normal[third_];
  }

  /// Returns the residuals of `position`.
  [[nodiscard]] Residuals residuals_to(const std::array<float, 3>& position) const noexcept {
    Residuals residuals{};
    const std::size_t a = next_axis(third_), b = next_axis(a);
    residuals[0] = code_.encode(a, double{position[a]}) - code_of(a, expected_[a]);
    residuals[1] = code_.encode(b, double{position[b]}) - code_of(b, expected_[b]);
    residuals[2] = code_.encode(third_, double{position[third_]}) - code_of(third_, third_expected(position));
    return residuals;
  }
  /// Sets `position` from its residuals. False if the position is out of the bounds.
  [[nodiscard]] bool restore_position(const Residuals& residuals, std::array<float, 3>& position) const noexcept {
    const std::size_t a = next_axis(third_), b = next_axis(a);
    position[a] = code_.decode(a, code_of(a, expected_[a]) + residuals[0]);
    position[b] = code_.decode(b, code_of(b, expected_[b]) + residuals[1]);
    if (!within(a, position[a]) || !within(b, position[b])) return false;
    position[third_] = code_.decode(third_, code_of(third_, third_expected(position)) + residuals[2]);
    return within(third_, position[third_]);
  }

 private:
  using Point = std::array<double, 3>;
  // Fitted by least squares to bunny, organ and dragon together. Constants fitted to one model alone save at most 0.1
  // bit more.
  static constexpr double kTowardsParent = 0.25, kAwayFromEnds = 0.14;

  static std::size_t next_axis(std::size_t axis) noexcept { return axis == 2 ? 0 : axis + 1; }
  static Point point(const std::array<float, 3>& p) noexcept { return {double{p[0]}, double{p[1]}, double{p[2]}}; }
  [[nodiscard]] double third_expected(const std::array<float, 3>& position) const noexcept {
    const std::size_t a = next_axis(third_), b = next_axis(a);
    return expected_[third_] + slope_[a] * (double{position[a]} - expected_[a]) +
           slope_[b] * (double{position[b]} - expected_[b]);
  }
  [[nodiscard]] std::uint32_t code_of(std::size_t axis, double coordinate) const noexcept {
    return code_.encode(axis,
                        std::clamp(coordinate, double{summary_.bounds_min[axis]}, double{summary_.bounds_max[axis]}));
  }
  /// False if the coordinate is out of the bounds or NaN.
  [[nodiscard]] bool within(std::size_t axis, float coordinate) const noexcept {
    return coordinate >= summary_.bounds_min[axis] && coordinate <= summary_.bounds_max[axis];
  }

  const ModelSummary& summary_;
  PositionCode code_;
  std::size_t third_ = 0;
  Point expected_{}, slope_{};
};

}  // namespace tactus::spm
