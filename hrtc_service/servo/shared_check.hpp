/// Checks values that the servo has copied from memory that it shares with the gateway. The gateway has checked the
/// samples of the session by the same rules (session/check.hpp), but the servo does not trust it.
///
/// Realtime.
#pragma once

#include <cstdint>

#include "haptics/coupling.hpp"
#include "hrtc_service/servo/device_link.hpp"
#include "session/clock.hpp"

namespace tactus::hrtc_service {

/// Returns whether differences between such times do not overflow.
[[nodiscard]] constexpr bool is_moderate(std::int64_t ns) noexcept {
  return ns > -(INT64_C(1) << 60) && ns < INT64_C(1) << 60;
}
/// Returns whether all numbers are finite and at most 1e9, and the orientation is a unit quaternion.
[[nodiscard]] bool is_valid(const haptics::BodyState& state) noexcept;
/// Returns whether the clock map gives moderate times, with a slew and a drift of at most 1 s/s.
[[nodiscard]] bool is_valid(const session::ClockMap& clock) noexcept;
/// Returns whether body, force and waves are finite and at most 1e9, and no energy is negative.
[[nodiscard]] bool is_valid(const haptics::CopySample& sample) noexcept;
/// Returns whether the source is known, and the start of a hand is finite, at most 1e9 and a unit quaternion.
[[nodiscard]] bool is_valid(const ProbeOrder& order) noexcept;
/// Returns whether the path has 1 to kMaxHandWaypoints waypoints, with moderate times and valid poses.
[[nodiscard]] bool is_valid(const haptics::HandPath& path) noexcept;
/// Returns whether pose and velocity are valid, the times moderate and the transit from 0 to
/// RemoteTiming::kMaxTransitNs.
[[nodiscard]] bool is_valid(const haptics::TimedPose& timed) noexcept;

}  // namespace tactus::hrtc_service
