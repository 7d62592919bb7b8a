#include "sharing/pose_interpolator.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::sharing {

void PoseInterpolator::set_state(const BodyState& state, std::int64_t session_now_ns) noexcept {
  received_.state = state;
  received_.session_ns = session_now_ns;
  position_jump_.setZero();
  rotation_jump_.setZero();
}

BodyState PoseInterpolator::extrapolate_received(std::int64_t session_now_ns) const noexcept {
  const std::int64_t age_ns = std::max<std::int64_t>(0, session_now_ns - received_.session_ns);
  BodyState state = extrapolated(received_.state, 1e-9 * static_cast<double>(std::min(age_ns, kMaxExtrapolationNs)));
  if (age_ns > kMaxExtrapolationNs) {
    state.velocity.setZero();
    state.angular_velocity.setZero();
  }
  return state;
}

void PoseInterpolator::on_pose(const ReceivedPose& pose, std::int64_t session_now_ns) noexcept {
  const BodyState before = state_at(session_now_ns);
  received_ = pose;
  const BodyState after = extrapolate_received(session_now_ns);
  position_jump_ = before.position - after.position;
  rotation_jump_ = haptics::log_map(before.orientation * after.orientation.conjugate());
  jump_ns_ = session_now_ns;
}

BodyState PoseInterpolator::state_at(std::int64_t session_now_ns) const noexcept {
  BodyState state = extrapolate_received(session_now_ns);
  const double passed = 1e-9 * static_cast<double>(std::max<std::int64_t>(0, session_now_ns - jump_ns_));
  const double share = passed > 20 * kFade ? 0 : std::exp(-passed / kFade);
  if (share == 0) return state;
  state.position += share * position_jump_;
  state.orientation = (haptics::exp_map(share * rotation_jump_) * state.orientation).normalized();
  return state;
}

}  // namespace tactus::sharing
