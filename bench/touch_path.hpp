/// A tip that follows a surface and taps it in turn, from the air: poses as a device would have recorded them.
#pragma once

#include <cstdint>
#include <vector>

#include "bench/models.hpp"

namespace tactus::bench {

struct TouchPathSettings {
  double radius = 0.003;  ///< m, of the tip
  double depth = 0.0005;  ///< m, how deep the ball is in the surface while it follows
  double speed = 0.05;    ///< m/s along the surface
  double period = 0.001;  ///< s from one pose to the next
  std::uint32_t poses = 0;
  std::uint64_t seed = 1;
};

/// World metres, the object at the origin. The first second is an approach through the air; then 2 s of following and
/// 2 s of tapping in turn, the taps from 2 to 12 Hz and 3 mm high: up to 0.1 m/s across the surface. Throws as
/// surface_poses does.
[[nodiscard]] std::vector<spm::Vec3d> touch_path(const LoadedModel& subject, const TouchPathSettings& settings);

}  // namespace tactus::bench
