/// Computes the path of a tip that approaches a surface and then follows and taps it in turn.
#pragma once

#include <cstdint>
#include <vector>

#include "bench/models.hpp"

namespace tactus::bench {

struct TouchPathSettings {
  double radius = 0.003;  ///< m, of the tip
  double depth = 0.0005;  ///< depth of the tip in the surface while it follows, m
  double speed = 0.05;    ///< m/s along the surface
  double period = 0.001;  ///< time between successive poses, s
  std::uint32_t poses = 0;
  std::uint64_t seed = 1;
};

/// Returns `settings.poses` positions. World frame, metres, the object at the origin. The tip approaches for 1 s. Then
/// it follows the surface for 2 s and taps it for 2 s, in turn. Taps are 3 mm high. Their frequency rises from 2 to
/// 12 Hz, and with it their speed to 0.1 m/s. Throws as surface_poses does.
[[nodiscard]] std::vector<spm::Vec3d> touch_path(const LoadedModel& subject, const TouchPathSettings& settings);

}  // namespace tactus::bench
