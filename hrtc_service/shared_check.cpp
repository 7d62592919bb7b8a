#include "hrtc_service/shared_check.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::hrtc_service {
namespace {

constexpr double kMaxNumber = 1e9;  // as in session/check.cpp

/// False for a number that is not finite. The comparison is written so, because it is false for NaN.
template <class Vector>
bool all_moderate(const Vector& v) noexcept {
  return (v.array().abs() <= kMaxNumber).all();
}

}  // namespace

bool is_valid(const haptics::BodyState& state) noexcept {
  constexpr double kUnitTolerance = 1e-3;  // as in session/check.cpp
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

}  // namespace tactus::hrtc_service
