#include "hrtc_service/servo/shared_check.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::hrtc_service {
namespace {

// As in session/check.cpp.
constexpr double kMaxNumber = 1e9;
constexpr double kUnitTolerance = 1e-3;

/// False for a number that is not finite. The comparison is written so, because it is false for NaN.
template <class Vector>
bool all_moderate(const Vector& v) noexcept {
  return (v.array().abs() <= kMaxNumber).all();
}

bool are_moderate(const std::array<double, 3>& numbers) noexcept {
  return std::all_of(numbers.begin(), numbers.end(), [](double number) { return std::abs(number) <= kMaxNumber; });
}

bool is_unit(const std::array<double, 4>& quaternion) noexcept {
  return std::abs(Eigen::Map<const Eigen::Vector4d>(quaternion.data()).norm() - 1) <= kUnitTolerance;
}

}  // namespace

bool is_valid(const haptics::BodyState& state) noexcept {
  return all_moderate(state.position) && all_moderate(state.velocity) && all_moderate(state.angular_velocity) &&
         std::abs(state.orientation.norm() - 1) <= kUnitTolerance;
}

bool is_valid(const session::ClockMap& clock) noexcept {
  return is_moderate(clock.local_ns) && is_moderate(clock.session_ns) && is_moderate(clock.slew_until_ns) &&
         clock.bound_ns >= 0 && clock.bound_ns <= session::kClockUnknown && std::abs(clock.slew) <= 1 &&
         std::abs(clock.drift) <= 1;
}

bool is_valid(const haptics::CopySample& sample) noexcept {
  return is_moderate(sample.time_ns) && is_valid(sample.body) && all_moderate(sample.user_force) &&
         std::all_of(sample.waves.begin(), sample.waves.end(), [](const auto& wave) { return all_moderate(wave); }) &&
         std::all_of(sample.energy.begin(), sample.energy.end(),
                     [](double energy) { return energy >= 0 && energy <= kMaxNumber; });
}

bool is_valid(const ProbeOrder& order) noexcept {
  return order.source <= PoseSource::kRemote && are_moderate(order.start) && is_unit(order.orientation);
}

bool is_valid(const haptics::HandPath& path) noexcept {
  return path.count > 0 && path.count <= haptics::kMaxHandWaypoints &&
         std::all_of(path.waypoints.begin(), path.waypoints.begin() + path.count, [](const auto& waypoint) {
           return is_moderate(waypoint.time_ns) && are_moderate(waypoint.position) && is_unit(waypoint.orientation);
         });
}

bool is_valid(const haptics::TimedPose& timed) noexcept {
  const haptics::RemotePose& pose = timed.pose;
  if (!is_moderate(pose.arrived_ns) || !is_moderate(pose.measured_ns)) return false;
  const std::int64_t transit_ns = pose.arrived_ns - pose.measured_ns;
  return are_moderate(pose.position) && are_moderate(pose.velocity) && is_unit(pose.orientation) && transit_ns >= 0 &&
         transit_ns <= haptics::RemoteTiming::kMaxTransitNs && timed.round_trip >= 0 && timed.round_trip <= kMaxNumber;
}

}  // namespace tactus::hrtc_service
