/// Converts an intent into the path of a simulated hand.
#pragma once

#include <cstdint>

#include "haptics/simulated_device.hpp"
#include "session/messages.hpp"

namespace tactus::sharing {

/// `later_ns`: the hand's clock minus session time. The intent has passed wire/check.
[[nodiscard]] inline haptics::HandPath hand_path(const session::Intent& intent, std::int64_t later_ns) {
  haptics::HandPath path;
  path.buttons = intent.buttons;
  for (const session::Waypoint& waypoint : intent.path)
    path.waypoints[path.count++] = {waypoint.session_time_ns + later_ns, waypoint.pose.position,
                                    waypoint.pose.orientation};
  return path;
}

/// Sets the start of a hand that has not moved yet to the first waypoint.
inline void set_start(const session::Intent& first, haptics::HandSettings& hand) {
  const session::Pose& pose = first.path.front().pose;
  hand.start = {pose.position[0], pose.position[1], pose.position[2]};
  hand.start_orientation = {pose.orientation[3], pose.orientation[0], pose.orientation[1], pose.orientation[2]};
}

}  // namespace tactus::sharing
