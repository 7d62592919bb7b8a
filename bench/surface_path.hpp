/// A tip that follows a mesh's surface at constant speed: the poses that the benchmarks of the cycle are fed with.
///
/// A point walks straight on across faces, unfolding each edge, turns slowly at random, and turns back at borders and
/// non-manifold edges. The tip's centre stands off the surface so that the ball is `depth` deep, along a normal
/// smoothed over the ball's size; where walls are near, it is moved out until it is no deeper. Then the centres are
/// spaced evenly. File units.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "spm/model.hpp"

namespace tactus::bench {

struct PathSettings {
  double radius = 0;  ///< of the tip
  double depth = 0;   ///< how deep the ball is in the surface
  double step = 0;    ///< distance of the centre from one pose to the next
  std::uint32_t poses = 0;
  std::uint64_t seed = 1;
};

struct SurfacePose {
  spm::Vec3d centre;
  spm::Vec3d normal;  ///< unit, of the surface, smoothed over the ball's size along the path: it lags a little
};

/// `distance` gives the distance to the mesh. Allocates. Throws std::runtime_error when the walk gets stuck in
/// a needle too thin to be left.
[[nodiscard]] std::vector<SurfacePose> surface_poses(std::span<const std::array<float, 3>> vertices,
                                                     std::span<const std::array<std::uint32_t, 3>> faces,
                                                     const PathSettings& settings,
                                                     const std::function<double(const spm::Vec3d&)>& distance);
/// The centres alone.
[[nodiscard]] std::vector<spm::Vec3d> surface_path(std::span<const std::array<float, 3>> vertices,
                                                   std::span<const std::array<std::uint32_t, 3>> faces,
                                                   const PathSettings& settings,
                                                   const std::function<double(const spm::Vec3d&)>& distance);

struct HandPathSettings {
  double radius = 0;       ///< of the tip
  double depth = 0;        ///< how deep the ball is in the surface while it touches
  double speed = 0;        ///< units/s sideways, constant
  double bend_radius = 0;  ///< rms of the path's curvature is one over this
  double band = 3;         ///< Hz; the curvature has a flat spectrum in time up to here and nothing above
  double period = 0.001;   ///< s from one pose to the next
  double height = 0;       ///< the tip lifts off about this far for a third of the time; 0: never
  std::uint32_t poses = 0;
  std::uint64_t seed = 1;
};

/// A hand that strokes the surface. Sideways it moves at constant speed on a path whose curvature is a random function
/// of time with a limited band, in the plane of the surface as it is without its bumps; across that plane the tip goes
/// up and down as the surface below it does. From `start`, anywhere outside. `nearest` gives the nearest point of the
/// mesh. The same settings give the same path.
[[nodiscard]] std::vector<spm::Vec3d> hand_path(std::span<const std::array<float, 3>> vertices, const spm::Vec3d& start,
                                                const HandPathSettings& settings,
                                                const std::function<spm::Vec3d(const spm::Vec3d&)>& nearest);

}  // namespace tactus::bench
