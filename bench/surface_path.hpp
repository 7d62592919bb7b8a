/// Computes paths of a tip on the surface of a mesh, at constant speed, for benchmarks and tests.
///
/// A point moves on a geodesic across the faces, changes its direction slowly at random, and turns back at borders and
/// non-manifold edges. The tip's centre lies above the point, along a normal that is smoothed over the tip's radius, so
/// that the tip is `depth` deep. Where another part of the surface is nearer, the centre moves out along the normal
/// until the tip is no deeper than `depth`. Finally, the centres are resampled at equal distances. File units.
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
  double depth = 0;   ///< depth of the tip in the surface
  double step = 0;    ///< distance between the centres of successive poses
  std::uint32_t poses = 0;
  std::uint64_t seed = 1;
};

struct SurfacePose {
  spm::Vec3d centre;  ///< of the tip
  spm::Vec3d normal;  ///< unit normal of the surface, averaged over about one tip radius of the preceding path
};

/// Returns `settings.poses` poses. `distance` returns the distance from a point to the mesh. Allocates. Throws
/// std::runtime_error if the path ends in a face that is too thin to leave.
[[nodiscard]] std::vector<SurfacePose> surface_poses(std::span<const std::array<float, 3>> vertices,
                                                     std::span<const std::array<std::uint32_t, 3>> faces,
                                                     const PathSettings& settings,
                                                     const std::function<double(const spm::Vec3d&)>& distance);
/// Returns only the centres of surface_poses.
[[nodiscard]] std::vector<spm::Vec3d> surface_path(std::span<const std::array<float, 3>> vertices,
                                                   std::span<const std::array<std::uint32_t, 3>> faces,
                                                   const PathSettings& settings,
                                                   const std::function<double(const spm::Vec3d&)>& distance);

struct HandPathSettings {
  double radius = 0;       ///< of the tip
  double depth = 0;        ///< depth of the tip in the surface during contact
  double speed = 0;        ///< speed along the smoothed surface, units/s
  double bend_radius = 0;  ///< 1 divided by the root mean square of the path's curvature
  double band = 3;         ///< bandwidth of the curvature as a function of time, Hz
  double period = 0.001;   ///< time between successive poses, s
  double height = 0;       ///< scale of the lifts, which take a third of the time; 0: no lifts
  std::uint32_t poses = 0;
  std::uint64_t seed = 1;
};

/// Returns the centres of a tip in a hand that strokes the surface.
///
/// The hand moves at constant speed along the smoothed surface. The curvature of its path is a band-limited random
/// function of time. Perpendicular to the smoothed surface, the tip follows the mesh. `start`: any point outside the
/// mesh. `nearest` returns the nearest point of the mesh. The same settings give the same path.
[[nodiscard]] std::vector<spm::Vec3d> hand_path(std::span<const std::array<float, 3>> vertices, const spm::Vec3d& start,
                                                const HandPathSettings& settings,
                                                const std::function<spm::Vec3d(const spm::Vec3d&)>& nearest);

}  // namespace tactus::bench
