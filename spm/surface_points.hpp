/// A few points on a model's surface, at which participants without a mesh can aim.
///
/// Each point is on the finest surface: a vertex of the base mesh, which is an original vertex, or the centre of a base
/// face that no vertex split changes. Model frame, file units. Allocates; not realtime.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "spm/model.hpp"

namespace tactus::spm {

struct SurfacePoint {
  std::array<float, 3> position{};
  std::array<float, 3> normal{};  ///< unit, outward, of the base mesh; zero where its faces cancel out
};

struct SurfacePoints {
  std::vector<SurfacePoint> points;
  /// Every point of the finest surface is within this distance of a surface point.
  double spacing = 0;
};

/// At most `max` points. Each next point is the one farthest from the previous points (T. Gonzalez, "Clustering to
/// minimize the maximum intercluster distance", 1985). O(max x base faces). Empty for a mesh without faces.
[[nodiscard]] SurfacePoints surface_points(const BaseMesh& base, std::size_t max);

}  // namespace tactus::spm
