/// Selects a few points on a model's surface, at which participants without a mesh can aim.
///
/// Each point is on the finest surface: either a vertex of the base mesh, which is also a vertex of the original mesh,
/// or the centre of a base face that no vertex split changes. Model frame, file units. Allocates; not realtime.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "spm/model.hpp"

namespace tactus::spm {

struct SurfacePoint {
  std::array<float, 3> position{};
  std::array<float, 3> normal{};  ///< outward unit normal of the base mesh; zero where its face normals cancel out
};

struct SurfacePoints {
  std::vector<SurfacePoint> points;
  /// Every point of the finest surface is within this distance of a surface point.
  double spacing = 0;
};

/// Selects at most `max` points. Each next point is the candidate farthest from the points before (T. Gonzalez,
/// "Clustering to minimize the maximum intercluster distance", 1985). O(max x base faces). Selects none for a mesh
/// without faces.
[[nodiscard]] SurfacePoints surface_points(const BaseMesh& base, std::size_t max);

}  // namespace tactus::spm
