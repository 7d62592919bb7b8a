/// Converts an intent into the path of a simulated hand.
#pragma once

#include <cstdint>

#include "haptics/simulated_device.hpp"
#include "session/messages.hpp"

namespace tactus::sharing {

/// Returns the path with times of the hand's clock. `clock_offset_ns`: the hand's clock minus session time. The caller
/// has validated the intent (session/check.hpp).
[[nodiscard]] inline haptics::HandPath hand_path(const session::Intent& intent, std::int64_t clock_offset_ns) {
  haptics::HandPath path;
  path.buttons = intent.buttons;
  for (const session::Waypoint& waypoint : intent.path)
    path.waypoints[path.count++] = {waypoint.session_time_ns + clock_offset_ns, waypoint.pose.position,
                                    waypoint.pose.orientation};
  return path;
}

/// Sets the start pose of a simulated hand to the first waypoint of its first intent.
inline void set_start(const session::Intent& first, haptics::HandSettings& hand) {
  const session::Pose& pose = first.path.front().pose;
  hand.start = {pose.position[0], pose.position[1], pose.position[2]};
  hand.start_orientation = {pose.orientation[3], pose.orientation[0], pose.orientation[1], pose.orientation[2]};
}

}  // namespace tactus::sharing
