/// A few points of a model's surface, for participants that hold no mesh: where it can be touched.
///
/// Each point lies on the finest surface: it is a vertex of the base mesh, which is an original vertex, or the centre
/// of a base face that no vertex split changes. Model frame, file units. Allocates; not realtime.
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
  /// No point of the finest surface is further than this from all of them: a line further away misses the object.
  double spacing = 0;
};

/// At most `most` points, each as far from the earlier ones as there is (T. Gonzalez, "Clustering to minimize the
/// maximum intercluster distance", 1985). O(most x base faces). Empty for a mesh without faces.
[[nodiscard]] SurfacePoints surface_points(const BaseMesh& base, std::size_t max);

}  // namespace tactus::spm
