/// Simulates a hand that moves a tool on a surface: poses for the benchmark of tools with six degrees of freedom.
///
/// The tip follows a path on the surface at varying speed and depth, lifts off and taps. The tool tilts about two axes
/// by up to `lean` each, and rotates about its own axis by up to twice `lean`. It rests at the end of each period of
/// 4 s. Speed, depth and angles are sums of sines whose periods differ, so that the motion does not repeat.
/// World frame, metres.
#pragma once

#include <cstdint>
#include <vector>

#include "bench/models.hpp"
#include "haptics/tool.hpp"

namespace tactus::bench {

struct ToolPathSettings {
  double radius = 0.003;  ///< m, of the tip
  double speed = 0.3;     ///< max speed of the tip along the surface, m/s
  double depth = 0.03;    ///< max depth of the device below the surface, m
  double lean = 1.9;      ///< max tilt about each of two axes, rad
  double period = 0.001;  ///< time between successive poses, s
  std::uint32_t poses = 0;
  std::uint64_t seed = 1;
};

struct ToolPathPose {
  haptics::ToolPose device;
  bool at_rest = false;  ///< the device has rested so long that force and torque should be constant
};

/// Returns `settings.poses` poses. Throws as surface_poses does.
[[nodiscard]] std::vector<ToolPathPose> tool_path(const LoadedModel& subject, const ToolPathSettings& settings);

}  // namespace tactus::bench
