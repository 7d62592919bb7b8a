#include <algorithm>

#include "client_sim/operator.hpp"

namespace tactus::client_sim {

namespace {

constexpr double kMaxContactLoss = 0.1;  // s; after it, a lift or hold has failed
constexpr double kCarriedShare = 0.9;    // share of a load that the arm carries; 1 would cancel the measured force
constexpr double kPeakSpeed = 1.5;       // max of the derivative of `smooth_step`

/// Maps 0..1 onto 0..1 with zero slope at both ends.
double smooth_step(double share) {
  const double s = std::clamp(share, 0.0, 1.0);
  return s * s * (3 - 2 * s);
}

}  // namespace

/// Returns whether at least `action.min_other_users` other users press on the object with `force`.
bool Operator::others_press(const Action& action, double force) const {
  constexpr std::int64_t kMaxAgeNs = 200'000'000;
  const auto count = std::count_if(others_.begin(), others_.end(), [&](const auto& entry) {
    const Other& other = entry.second;
    return other.object == view_.id && other.force >= force && state_ns_ - other.received_ns < kMaxAgeNs;
  });
  return count >= static_cast<std::ptrdiff_t>(action.min_other_users);
}

void Operator::start_lift() {
  stage_ = Stage::kPressTogether;
  stage_time_ = together_time_ = loss_time_ = 0;
  anchor_ = device_;
  load_.setZero();
  push_depth_ = std::max(0.0, (device_ - hand_).dot(outwards_));
}

/// Adjusts the push depth to press with `force`, N.
void Operator::press(double force, double time_constant, double dt) {
  constexpr double kMaxPushDepth = 0.08;  // m
  push_depth_ +=
      (force - smoothed_force_.dot(outwards_)) / settings_.hand_stiffness * std::min(1.0, dt / time_constant);
  push_depth_ = std::clamp(push_depth_, 0.0, kMaxPushDepth);
}

void Operator::track_load(const Vec3d& load, double time_constant, double dt) {
  load_ += (load - load_) * std::min(1.0, dt / time_constant);
}

/// Returns the displacement at which the hand's stiffness carries the arm's share of the load, m.
Vec3d Operator::load_offset() const { return load_ * (kCarriedShare / settings_.hand_stiffness); }

void Operator::press_together(const Action& action, double dt) {
  constexpr double kMinShare = 0.85;        // share of the force that each user has to reach
  constexpr double kMinTogetherTime = 0.2;  // s
  constexpr double kPressTime = 0.25;       // s
  loss_time_ = is_touching() ? 0 : loss_time_ + dt;
  if (loss_time_ > kMaxContactLoss) {
    ++tally_.lifts_lost;
    stage_ = Stage::kPlan;
    return;
  }
  // A hand that pressed alone with the full force would push the object away, so it waits for the others.
  const bool others_touch = others_press(action, 0.3 * kWaitingForce);
  press(others_touch ? action.force : kWaitingForce, kPressTime, dt);
  const double min_force = kMinShare * action.force;
  const bool all_press = others_touch && smoothed_force_.dot(outwards_) > min_force && others_press(action, min_force);
  together_time_ = all_press ? together_time_ + dt : 0;
  hand_ = anchor_ - outwards_ * push_depth_;
  if (together_time_ < kMinTogetherTime) return;
  stage_ = Stage::kLift;
  stage_time_ = 0;
}

/// Lifts, holds and lowers the object, and carries the load that the hand measures.
void Operator::lift(const Action& action, double dt) {
  constexpr double kLoadTime = 1;      // s; with a shorter time an object that is held at points would swing
  constexpr double kPressTime = 0.5;   // s
  constexpr double kGroundTime = 0.3;  // s for which the object stands on the ground before the hand leaves
  loss_time_ = is_touching() ? 0 : loss_time_ + dt;
  if (loss_time_ > kMaxContactLoss) {
    ++tally_.lifts_lost;
    stage_ = Stage::kPlan;
    return;
  }
  const double travel_time = action.height / action.speed * kPeakSpeed;  // s
  const double lowering_begins = travel_time + action.seconds;
  const double raised = action.height * (smooth_step(stage_time_ / travel_time) -
                                         smooth_step((stage_time_ - lowering_begins) / travel_time));
  press(action.force, kPressTime, dt);
  const Vec3d before = hand_;
  track_load(smoothed_force_ - outwards_ * smoothed_force_.dot(outwards_), kLoadTime, dt);
  hand_ = anchor_ - outwards_ * push_depth_ + Vec3d::UnitZ() * raised - load_offset();
  hand_velocity_ = (hand_ - before) / dt;
  if (stage_time_ < lowering_begins + travel_time + kGroundTime) return;
  ++tally_.lifts;
  leave_object();
}

void Operator::grab() {
  constexpr double kPatience = 0.5;  // s
  if (is_holding_) {
    ++tally_.grabs;
    loss_time_ = 0;
    next_action();
  } else if (is_refused_ || stage_time_ > kPatience) {
    ++tally_.grabs_refused;
    end_hold();
  }
}

void Operator::start_moving() {
  stage_ = Stage::kMove;
  anchor_ = hand_ + load_offset();
}

void Operator::move_object(const Action& action, double dt) {
  constexpr double kLoadTime = 0.12;  // s
  loss_time_ = is_holding_ ? 0 : loss_time_ + dt;
  if (loss_time_ > kMaxContactLoss) {
    ++tally_.grabs_lost;
    return end_hold();
  }
  const double travel_time = action.displacement.norm() / action.speed * kPeakSpeed;  // s
  const Vec3d before = hand_;
  track_load(smoothed_force_, kLoadTime, dt);
  hand_ =
      anchor_ + action.displacement * (travel_time > 0 ? smooth_step(stage_time_ / travel_time) : 1.0) - load_offset();
  hand_velocity_ = (hand_ - before) / dt;
  if (stage_time_ >= travel_time + action.seconds) next_action();
}

void Operator::start_release() {
  // A move counts the loss of its hold itself, and ends the hold. After a wait, the loss is counted only here.
  if (loss_time_ > kMaxContactLoss) ++tally_.grabs_lost;
  stage_ = Stage::kRelease;
  buttons_ = 0;
}

void Operator::release() {
  constexpr double kPatience = 1;  // s
  if (is_holding_ && stage_time_ < kPatience) return;
  leave_object();
}

/// Starts to move the hand away from the object. The action ends when the hand arrives.
void Operator::leave_object() {
  route_ = {device_ + outwards_ * (settings_.clearance + user_.radius)};
  hand_ = device_;
  stage_ = Stage::kTravel;
  is_leaving_ = true;
}

/// Ends the action because the hand holds no object. `begin_action` then skips the actions that need a held object.
void Operator::end_hold() {
  buttons_ = 0;
  next_action();
}

}  // namespace tactus::client_sim
