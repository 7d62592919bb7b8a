/// A hand that works at a surface with a tool: poses for the 6-DoF benchmark and its tests.
///
/// The tip's place on the surface wanders at a speed that swells and dies away; it is pressed in deeper and less deep,
/// lifts off and taps; the tool leans about all axes, as far as `lean`, and turns about its own; now and then all of it
/// stands still. Every part is a sum of sines with periods of its own, so that nothing repeats. World frame, metres.
#pragma once

#include <cstdint>
#include <vector>

#include "bench/models.hpp"
#include "haptics/tool.hpp"

namespace tactus::bench {

struct ToolPathSettings {
  double radius = 0.003;  ///< m, of the tip
  double speed = 0.3;     ///< m/s, greatest of the tip along the surface
  double depth = 0.03;    ///< m, greatest by which the device is pressed in
  double lean = 1.9;      ///< rad off the surface's normal
  double period = 0.001;  ///< s
  std::uint32_t poses = 0;
  std::uint64_t seed = 1;
};

struct ToolPathPose {
  haptics::ToolPose device;
  bool at_rest = false;  ///< stands still, and has done so for long enough that what is touched should rest too
};

[[nodiscard]] std::vector<ToolPathPose> tool_path(const LoadedModel& subject, const ToolPathSettings& settings);

}  // namespace tactus::bench
