#include "client_sim/operator.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "haptics/rigid_body.hpp"
#include "spm/rotation.hpp"

namespace tactus::client_sim {

namespace {

constexpr double kMinContactForce = 0.03;  // N; with a smaller force, a state does not count as contact
constexpr double kSmoothingTime = 0.02;    // s, time constant for received forces and velocities

// The states of other users: max age, as in `others_press`, and max number of users.
constexpr std::int64_t kMaxOtherAgeNs = 200'000'000;
constexpr std::size_t kMaxOthers = 256;

session::Pose pose_of(const Vec3d& position, const Eigen::Quaterniond& orientation) {
  return {{position.x(), position.y(), position.z()},
          {orientation.x(), orientation.y(), orientation.z(), orientation.w()}};
}

/// Returns the tilt of a hand after `seconds` of following: angles from -max to max rad about two axes, and from -2 max
/// to 2 max about the hand's z axis.
Eigen::Quaterniond tilt_after(double max, double seconds) {
  constexpr double kTwoPi = 6.283185307179586;
  constexpr double kFrequencies[3]{0.31, 0.23, 0.17};  // Hz; the joint motion repeats only after 100 s
  const auto swing = [&](int axis) { return std::sin(kTwoPi * kFrequencies[axis] * seconds); };
  return haptics::exp_map(max * Vec3d{swing(0), swing(1), 2 * swing(2)});
}

}  // namespace

Operator::Operator(const User& user, const OperatorSettings& settings)
    : user_{user},
      settings_{settings},
      user_id_{session::id_of(user.name)},
      tilts_hand_{
          std::any_of(user.script.begin(), user.script.end(), [](const Action& action) { return action.tilt > 0; })} {}

bool Operator::is_touching() const noexcept { return in_contact_ && force_norm_ > kMinContactForce; }

void Operator::on_probe_state(const session::ProbeState& state) {
  if (state.user_id != user_id_ || (has_state_ && state.session_time_ns <= state_ns_)) return;
  const Vec3d proxy = vector_of(state.proxy);
  const Vec3d force = vector_of(state.force);
  const double dt = has_state_ ? static_cast<double>(state.session_time_ns - state_ns_) * 1e-9 : 0;
  const double share = dt / (dt + kSmoothingTime);
  if (has_state_ && dt > 0) proxy_velocity_ += share * ((proxy - proxy_) / dt - proxy_velocity_);
  device_ = vector_of(state.device.position);
  proxy_ = proxy;
  if (!has_state_) hand_ = device_;
  has_state_ = true;
  state_ns_ = state.session_time_ns;
  std::erase_if(others_, [&](const auto& other) { return state_ns_ - other.second.received_ns >= kMaxOtherAgeNs; });
  smoothed_force_ += share * (force - smoothed_force_);
  force_norm_ = force.norm();
  smoothed_norm_ += share * (force_norm_ - smoothed_norm_);
  const bool contact = (state.status & session::kInContact) != 0 && force_norm_ > kMinContactForce;
  if (contact) {
    // Friction tilts the force from the normal, against the tip's velocity. As the velocity is tangential to the
    // surface, the force without its component along the velocity has the direction of the normal.
    constexpr double kMinSlidingSpeed = 0.01;  // m/s
    Vec3d normal = force / force_norm_;
    if (proxy_velocity_.norm() > kMinSlidingSpeed && in_contact_) {
      const Vec3d direction = proxy_velocity_.normalized();
      const Vec3d upright = normal - direction * direction.dot(normal);
      constexpr double kMinCosine = 0.7;  // of the tilt; a larger tilt does not come from friction
      if (upright.norm() > kMinCosine) normal = upright.normalized();
    }
    normal_ = in_contact_ ? Vec3d((normal_ + share * (normal - normal_)).normalized()) : normal;
  }
  in_contact_ = contact;
  is_holding_ = (state.status & session::kHolding) != 0;
  is_refused_ = (state.status & session::kHoldRefused) != 0;
  const bool had_fault = has_fault_;
  has_fault_ = (state.status & session::kFault) != 0;
  if (has_fault_ && !had_fault) hand_ = device_;
}

void Operator::on_other_probe_state(const session::ProbeState& state) {
  if (state.user_id == user_id_) return;
  if (others_.size() >= kMaxOthers && others_.count(state.user_id) == 0) return;
  others_[state.user_id] = {state.object_id, vector_of(state.force).norm(), state_ns_};
}

std::optional<session::Intent> Operator::tick(std::int64_t session_now_ns, const Objects& objects) {
  if (!has_state_) return first_intent(session_now_ns, objects);
  if (ticked_ns_ == 0) ticked_ns_ = session_now_ns - settings_.period_ns;
  if (session_now_ns - ticked_ns_ < settings_.period_ns) return std::nullopt;
  constexpr double kMaxStep = 0.05;  // s; after a pause the hand continues from its last position
  const double dt = std::min(kMaxStep, static_cast<double>(session_now_ns - ticked_ns_) * 1e-9);
  ticked_ns_ = session_now_ns;
  hand_velocity_.setZero();
  // During a fault the hand does not move. It would move deep into the object, because no force stops it, and the reset
  // would then cause a large force.
  if (!has_fault_) run_stage(dt, objects);
  if (tilts_hand_) orient_hand(dt);

  session::Intent intent;
  intent.user_id = user_id_;
  intent.sequence = ++sequence_;
  intent.buttons = buttons_;
  const Vec3d ahead = hand_ + hand_velocity_ * (static_cast<double>(settings_.lookahead_ns) * 1e-9);
  intent.path = {{session_now_ns, pose_of(hand_, orientation_)},
                 {session_now_ns + settings_.lookahead_ns, pose_of(ahead, orientation_ahead_)}};
  return intent;
}

/// Aligns the hand with the direction of approach, or with the normal of the followed surface, and adds the tilt.
void Operator::orient_hand(double dt) {
  constexpr double kWristTime = 0.25;  // s, time constant of the wrist
  const bool is_following = stage_ == Stage::kFollow && !is_done_;
  const Vec3d before = hand_axis_;
  hand_axis_ =
      (hand_axis_ + std::min(1.0, dt / kWristTime) * ((is_following ? normal_ : outwards_) - hand_axis_)).normalized();
  // The smallest rotation from `before` to the new axis: it does not turn the hand about its axis.
  untilted_ = (spm::rotation_between(before, hand_axis_) * untilted_).normalized();
  const double lean = is_following ? user_.script[action_].tilt : 0;
  const double lookahead = static_cast<double>(settings_.lookahead_ns) * 1e-9;
  const Eigen::Quaterniond from = orientation_, goal = untilted_ * tilt_after(lean, followed_time_);
  // Interpolates, so that the orientation does not jump when a tilt ends.
  orientation_ = from.slerp(std::min(1.0, dt / kWristTime), goal).normalized();
  orientation_ahead_ = from.slerp(std::min(1.0, (dt + lookahead) / kWristTime),
                                  untilted_ * tilt_after(lean, followed_time_ + lookahead));
}

void Operator::next_action() {
  stage_ = Stage::kPlan;
  stage_time_ = 0;
  followed_time_ = 0;
  attempts_ = taps_ = 0;
  if (++action_ < user_.script.size()) return;
  action_ = 0;
  is_done_ = !user_.repeats_script;
}

void Operator::run_stage(double dt, const Objects& objects) {
  if (is_done_) return;
  const Action& action = user_.script[action_];
  stage_time_ += dt;
  switch (stage_) {
    case Stage::kPlan:
      if (begin_action(action, objects)) stage_time_ = 0;
      return;
    case Stage::kTravel: {
      const double speed = action.kind == ActionKind::kRetreat ? action.speed : settings_.travel_speed;
      if (!move_hand_towards(route_.back(), speed, dt)) return;
      route_.pop_back();
      if (!route_.empty()) return;
      stage_ = Stage::kSettle;
      stage_time_ = 0;
      return;
    }
    case Stage::kSettle: {
      constexpr double kSettleDistance = 0.002;  // m
      constexpr double kPatience = 1;            // s
      if ((device_ - hand_).norm() > kSettleDistance && stage_time_ < kPatience) return;
      if (action.kind == ActionKind::kRetreat || is_leaving_) {
        is_leaving_ = false;
        next_action();
      } else {
        stage_ = Stage::kApproach;
        stage_time_ = 0;
      }
      return;
    }
    case Stage::kApproach:
      approach(action, dt);
      return;
    case Stage::kPullBack:
      pull_back(action, dt);
      return;
    case Stage::kFollow:
      if (followed_time_ >= action.seconds) {
        next_action();
      } else {
        follow(action, dt);
      }
      return;
    case Stage::kPressTogether:
      press_together(action, dt);
      return;
    case Stage::kLift:
      lift(action, dt);
      return;
    case Stage::kGrab:
      grab();
      return;
    case Stage::kMove:
      move_object(action, dt);
      return;
    case Stage::kRelease:
      release();
      return;
    case Stage::kWait:
      loss_time_ = is_holding_ ? 0 : loss_time_ + dt;
      if (stage_time_ >= action.seconds) next_action();
      return;
  }
}

/// Chooses the first stage of an action. Returns false if its object is not available.
bool Operator::begin_action(const Action& action, const Objects& objects) {
  if (action.kind == ActionKind::kWait || (action.kind == ActionKind::kHold && action.force == 0)) {
    stage_ = Stage::kWait;
    return true;
  }
  if (action.kind == ActionKind::kMove || action.kind == ActionKind::kRelease) {
    if (buttons_ == 0) {
      next_action();
      return true;
    }
    if (action.kind == ActionKind::kMove) {
      start_moving();
    } else {
      start_release();
    }
    return true;
  }
  if (!action.object.empty()) object_ = action.object;
  const ObjectView* const view = find_object(objects, object_);
  if (view == nullptr) return false;
  const bool same_object = view->id == view_.id;
  view_ = *view;
  is_leaving_ = false;
  if (action.kind == ActionKind::kHold || (action.kind == ActionKind::kFollow && same_object && is_touching())) {
    start_following(action);
    return true;
  }
  if (action.kind == ActionKind::kRetreat) {
    const Vec3d out = way_out();
    route_ = {device_ + out * (exit_distance(view_, device_, out) + settings_.clearance)};
    hand_ = device_;
    stage_ = Stage::kTravel;
    return true;
  }
  outwards_ = (view_.rotation * action.direction).normalized();
  const Vec3d aim = aim_point(action, view_);
  approach_start_ = start_point(action, view_);
  max_travel_ = (approach_start_ - aim).norm() + exit_distance(view_, aim, -outwards_) + settings_.clearance;
  hand_ = device_;
  plan_route(approach_start_);
  has_first_contact_ = false;
  stage_ = Stage::kTravel;
  return true;
}

std::optional<session::Intent> Operator::first_intent(std::int64_t session_now_ns, const Objects& objects) {
  if (ticked_ns_ != 0 && session_now_ns - ticked_ns_ < settings_.period_ns) return std::nullopt;
  for (const Action& action : user_.script) {
    const ObjectView* const view = action.object.empty() ? nullptr : find_object(objects, action.object);
    if (view == nullptr) continue;
    ticked_ns_ = session_now_ns;
    const Vec3d start = start_point(action, *view);
    session::Intent intent;
    intent.user_id = user_id_;
    intent.sequence = ++sequence_;
    if (tilts_hand_) {  // the hand starts in the orientation of the approach
      hand_axis_ = (view->rotation * action.direction).normalized();
      untilted_ = orientation_ = orientation_ahead_ = spm::rotation_between(Vec3d::UnitZ(), hand_axis_);
    }
    intent.path = {{session_now_ns, pose_of(start, orientation_)}};
    return intent;
  }
  return std::nullopt;
}

/// Moves the hand by one step. Returns whether it has reached `target`.
bool Operator::move_hand_towards(const Vec3d& target, double speed, double dt) {
  const Vec3d path = target - hand_;
  const double distance = path.norm();
  if (distance <= speed * dt) {
    hand_ = target;
    return true;
  }
  hand_velocity_ = path * (speed / distance);
  hand_ += hand_velocity_ * dt;
  return false;
}

}  // namespace tactus::client_sim
