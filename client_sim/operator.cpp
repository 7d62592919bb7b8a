#include "client_sim/operator.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "haptics/device.hpp"
#include "haptics/rigid_body.hpp"

namespace tactus::client_sim {

namespace {

constexpr double kTouch = 0.03;      // N; a weaker force does not count as contact
constexpr double kSmoothing = 0.02;  // s, time constant for received forces
constexpr std::uint32_t kMaxAttempts = 5;
constexpr double kLightTouch = 0.5;  // N, at which a user waits for others to press
constexpr double kLost = 0.1;        // s without contact
constexpr double kShare = 0.9;  // share of a load that an arm carries; all of it would cancel the force it measures

/// Maps 0 to 1 onto 0 to 1 with zero speed at both ends.
double smooth(double share) {
  const double s = std::clamp(share, 0.0, 1.0);
  return s * s * (3 - 2 * s);
}

Vec3d vector_of(const std::array<double, 3>& a) { return {a[0], a[1], a[2]}; }

session::Pose pose_of(const Vec3d& position, const Eigen::Quaterniond& orientation) {
  return {{position.x(), position.y(), position.z()},
          {orientation.x(), orientation.y(), orientation.z(), orientation.w()}};
}

/// Tilt of a hand after `seconds`: up to `max` each way about two axes, and twice that about the tool's own axis.
Eigen::Quaterniond leaning(double max, double seconds) {
  constexpr double kTwoPi = 6.283185307179586;
  constexpr double kRates[3]{0.31, 0.23, 0.17};  // Hz, incommensurable, so that the motion does not repeat soon
  const auto swing = [&](int axis) { return std::sin(kTwoPi * kRates[axis] * seconds); };
  return haptics::exp_map(max * Vec3d{swing(0), swing(1), 2 * swing(2)});
}

/// A unit vector perpendicular to `axis`, the same for the same axis.
Vec3d across(const Vec3d& axis) {
  const Vec3d helper = std::abs(axis.x()) < 0.7 ? Vec3d::UnitX() : Vec3d::UnitY();
  return (helper - axis * axis.dot(helper)).normalized();
}

/// The nearest known point of the surface; without points the centre of the box.
Vec3d nearest_of(const ObjectView& view, const Vec3d& from) {
  const auto nearer = [&](const ObjectView::SurfacePoint& a, const ObjectView::SurfacePoint& b) {
    return (a.position - from).squaredNorm() < (b.position - from).squaredNorm();
  };
  const auto nearest = std::min_element(view.surface.begin(), view.surface.end(), nearer);
  return nearest == view.surface.end() ? view.centre : nearest->position;
}

/// Extent of the box from its centre along a unit vector.
double reach_along(const ObjectView& view, const Vec3d& direction) {
  return (view.rotation.transpose() * direction).cwiseAbs().dot(view.half);
}

/// Distance from a point inside the box to its boundary along a ray.
double exit_distance(const ObjectView& view, const Vec3d& from, const Vec3d& direction) {
  const Vec3d p = view.rotation.transpose() * (from - view.centre);
  const Vec3d d = view.rotation.transpose() * direction;
  double nearest = 2 * view.half.norm();
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(d[axis]) > 1e-9) {
      nearest = std::min(nearest, (std::copysign(view.half[axis], d[axis]) - p[axis]) / d[axis]);
    }
  }
  return std::max(nearest, 0.0);
}

}  // namespace

ObjectView view_of(const session::CatalogueEntry& entry) {
  const Eigen::Quaterniond rotation{entry.pose.orientation[3], entry.pose.orientation[0], entry.pose.orientation[1],
                                    entry.pose.orientation[2]};
  const auto& low = entry.summary.bounds_min;
  const auto& high = entry.summary.bounds_max;
  Vec3d centre;
  ObjectView view;
  for (int axis = 0; axis < 3; ++axis) {
    centre[axis] = 0.5 * (static_cast<double>(low[axis]) + static_cast<double>(high[axis]));
    view.half[axis] = 0.5 * entry.scale * (static_cast<double>(high[axis]) - static_cast<double>(low[axis]));
  }
  view.id = entry.object_id;
  view.moves = entry.body.mass > 0;
  view.rotation = rotation.normalized().toRotationMatrix();
  view.centre = view.rotation * (entry.scale * centre) + vector_of(entry.pose.position);
  const auto vector = [](const std::array<float, 3>& a) { return Vec3d{double{a[0]}, double{a[1]}, double{a[2]}}; };
  for (const spm::SurfacePoint& point : entry.surface.points)
    view.surface.push_back({view.rotation * (entry.scale * vector(point.position)) + vector_of(entry.pose.position),
                            view.rotation * vector(point.normal)});
  view.spacing = entry.scale * entry.surface.spacing;
  return view;
}

const ObjectView* find_object(const Objects& objects, const std::string& reference) {
  if (const std::uint32_t ordinal = ordinal_of(reference); ordinal > 0) {
    std::vector<const ObjectView*> fixed;
    for (const auto& [name, view] : objects)
      if (!view.moves) fixed.push_back(&view);
    return fixed.empty() ? nullptr : fixed[(ordinal - 1) % fixed.size()];
  }
  const auto found = objects.find(reference);
  return found == objects.end() ? nullptr : &found->second;
}

Operator::Operator(const User& user, const OperatorSettings& settings)
    : user_{user},
      settings_{settings},
      user_id_{session::id_of(user.name)},
      leans_{
          std::any_of(user.script.begin(), user.script.end(), [](const Action& action) { return action.lean > 0; })} {}

bool Operator::touching() const noexcept { return in_contact_ && raw_force_ > kTouch; }

void Operator::on_probe_state(const session::ProbeState& state) {
  if (state.user_id != user_id_ || (has_state_ && state.session_time_ns <= state_ns_)) return;
  const Vec3d proxy = vector_of(state.proxy);
  const Vec3d force = vector_of(state.force);
  const double dt = has_state_ ? static_cast<double>(state.session_time_ns - state_ns_) * 1e-9 : 0;
  const double share = dt / (dt + kSmoothing);
  if (has_state_ && dt > 0) travel_ += share * ((proxy - proxy_) / dt - travel_);
  device_ = vector_of(state.device.position);
  proxy_ = proxy;
  if (!has_state_) hand_ = device_;
  has_state_ = true;
  state_ns_ = state.session_time_ns;
  felt_force_ += share * (force - felt_force_);
  raw_force_ = force.norm();
  force_ += share * (raw_force_ - force_);
  const bool contact = (state.status & session::kInContact) != 0 && raw_force_ > kTouch;
  if (contact) {
    // Friction tilts the force against the tip's velocity, which is tangential to the surface.
    constexpr double kMoving = 0.01;
    Vec3d normal = force / raw_force_;
    if (travel_.norm() > kMoving && in_contact_) {
      const Vec3d direction = travel_.normalized();
      const Vec3d upright = normal - direction * direction.dot(normal);
      constexpr double kMaxTilt = 0.7;  // cosine; a greater tilt is not friction
      if (upright.norm() > kMaxTilt) normal = upright.normalized();
    }
    normal_ = in_contact_ ? Vec3d((normal_ + share * (normal - normal_)).normalized()) : normal;
  }
  in_contact_ = contact;
  holding_ = (state.status & session::kHolding) != 0;
  refused_ = (state.status & session::kHoldRefused) != 0;
  const bool was_off = off_;
  off_ = (state.status & session::kFault) != 0;
  if (off_ && !was_off) hand_ = device_;
}

void Operator::on_other(const session::ProbeState& state) {
  if (state.user_id == user_id_) return;
  others_[state.user_id] = {state.object_id, vector_of(state.force).norm(), state_ns_};
}

std::optional<session::Intent> Operator::tick(std::int64_t session_now_ns, const Objects& objects) {
  if (!has_state_) return first_intent(session_now_ns, objects);
  if (ticked_ns_ == 0) ticked_ns_ = session_now_ns - settings_.period_ns;
  if (session_now_ns - ticked_ns_ < settings_.period_ns) return std::nullopt;
  constexpr double kLongestStep = 0.05;  // after a pause the hand continues without catching up
  const double dt = std::min(kLongestStep, static_cast<double>(session_now_ns - ticked_ns_) * 1e-9);
  ticked_ns_ = session_now_ns;
  hand_velocity_.setZero();
  // A hand that pressed on would be deep in the object by the reset, and be thrown out.
  if (!off_) act(dt, objects);
  if (leans_) orient_hand(dt);

  session::Intent intent;
  intent.user_id = user_id_;
  intent.sequence = ++sequence_;
  intent.buttons = buttons_;
  const Vec3d ahead = hand_ + hand_velocity_ * (static_cast<double>(settings_.lookahead_ns) * 1e-9);
  intent.path = {{session_now_ns, pose_of(hand_, orientation_)},
                 {session_now_ns + settings_.lookahead_ns, pose_of(ahead, ahead_)}};
  return intent;
}

/// Aligns the hand with the direction of approach, or with the normal of the followed surface, and adds the tilt.
void Operator::orient_hand(double dt) {
  constexpr double kWrist = 0.25;  // s, time constant of the wrist
  const bool follows = stage_ == Stage::kFollow && !done_;
  const Vec3d before = upright_;
  upright_ = (upright_ + std::min(1.0, dt / kWrist) * ((follows ? normal_ : outwards_) - upright_)).normalized();
  base_ = (Eigen::Quaterniond::FromTwoVectors(before, upright_) * base_).normalized();  // no rotation about the normal
  const double lean = follows ? user_.script[action_].lean : 0;
  const double lookahead = static_cast<double>(settings_.lookahead_ns) * 1e-9;
  const Eigen::Quaterniond from = orientation_, goal = base_ * leaning(lean, followed_);
  // Smooths the step where a tilt ends.
  orientation_ = from.slerp(std::min(1.0, dt / kWrist), goal).normalized();
  ahead_ = from.slerp(std::min(1.0, (dt + lookahead) / kWrist), base_ * leaning(lean, followed_ + lookahead));
}

void Operator::next_action() {
  stage_ = Stage::kBegin;
  clock_ = 0;
  followed_ = 0;
  attempts_ = taps_ = 0;
  if (++action_ < user_.script.size()) return;
  action_ = 0;
  done_ = !user_.repeat;
}

void Operator::act(double dt, const Objects& objects) {
  if (done_) return;
  const Action& action = user_.script[action_];
  clock_ += dt;
  switch (stage_) {
    case Stage::kBegin:
      if (begin(action, objects)) clock_ = 0;
      return;
    case Stage::kTravel: {
      const double speed = action.kind == ActionKind::kRetreat ? action.speed : settings_.travel_speed;
      if (!go_to(route_.back(), speed, dt)) return;
      route_.pop_back();
      if (!route_.empty()) return;
      stage_ = Stage::kSteady;
      clock_ = 0;
      return;
    }
    case Stage::kSteady: {
      constexpr double kNear = 0.002;
      constexpr double kPatience = 1;
      if ((device_ - hand_).norm() > kNear && clock_ < kPatience) return;
      if (action.kind == ActionKind::kRetreat || released_) {
        released_ = false;
        next_action();
      } else {
        stage_ = Stage::kPressIn;
        clock_ = 0;
      }
      return;
    }
    case Stage::kPressIn:
      press_in(action, dt);
      return;
    case Stage::kLiftOff:
      lift_off(action, dt);
      return;
    case Stage::kFollow:
      if (followed_ >= action.seconds) {
        next_action();
      } else {
        follow(action, dt);
      }
      return;
    case Stage::kGrip:
      grip(action, dt);
      return;
    case Stage::kCarry:
      carry(action, dt);
      return;
    case Stage::kClose:
      close_hand(dt);
      return;
    case Stage::kMove:
      move_held(action, dt);
      return;
    case Stage::kOpen:
      open_hand();
      return;
    case Stage::kStill:
      if (clock_ >= action.seconds) next_action();
      return;
  }
}

bool Operator::begin(const Action& action, const Objects& objects) {
  if (action.kind == ActionKind::kWait || (action.kind == ActionKind::kHold && action.force == 0)) {
    stage_ = Stage::kStill;
    return true;
  }
  if (action.kind == ActionKind::kMove || action.kind == ActionKind::kRelease) {
    if (buttons_ == 0) {
      next_action();
      return true;
    }
    const bool moves = action.kind == ActionKind::kMove;
    stage_ = moves ? Stage::kMove : Stage::kOpen;
    if (!moves) buttons_ = 0;
    gripped_ = hand_ + load_ * (kShare / settings_.hand_stiffness);
    return true;
  }
  if (!action.object.empty()) object_ = action.object;
  const ObjectView* const view = find_object(objects, object_);
  if (view == nullptr) return false;  // not served yet, or withdrawn: wait for it
  const bool same_object = view->id == view_.id;
  view_ = *view;
  released_ = false;
  if (action.kind == ActionKind::kHold || (action.kind == ActionKind::kFollow && same_object && touching())) {
    start_following(action);
    return true;
  }
  if (action.kind == ActionKind::kRetreat) {
    route_ = {device_ + outwards_ * (exit_distance(view_, device_, outwards_) + settings_.clearance)};
    hand_ = device_;
    stage_ = Stage::kTravel;
    return true;
  }
  outwards_ = (view_.rotation * action.direction).normalized();
  const Vec3d aim = aim_at(action, view_);
  start_ = start_of(action, view_);
  depth_ = (start_ - aim).norm() + exit_distance(view_, aim, -outwards_) + settings_.clearance;
  hand_ = device_;
  plan_route(start_);
  has_touched_ = false;
  stage_ = Stage::kTravel;
  return true;
}

/// The point that the script names, unless a hand along its direction misses the surface there. It misses when the line
/// is further from all points of the surface than their spacing, or when an attempt has just failed. Then one of these
/// points: near that line and facing the hand. Each further attempt takes the next.
Vec3d Operator::aim_at(const Action& action, const ObjectView& view) const {
  const Vec3d named = view.centre + view.rotation * ((2 * action.point - Vec3d::Ones()).cwiseProduct(view.half));
  if (view.surface.empty()) return named;
  const Vec3d outwards = (view.rotation * action.direction).normalized();
  double nearest = std::numeric_limits<double>::infinity();
  std::vector<std::pair<double, const Vec3d*>> ranked;
  for (const ObjectView::SurfacePoint& point : view.surface) {
    const Vec3d from = point.position - named;
    const double distance = (from - outwards * outwards.dot(from)).norm();
    nearest = std::min(nearest, distance);
    ranked.emplace_back(distance + view.spacing * (1 - outwards.dot(point.normal)), &point.position);
  }
  const bool may_hit = nearest <= view.spacing + user_.radius;
  if (may_hit && attempts_ == 0) return named;
  const std::size_t rank = (attempts_ - (may_hit ? 1 : 0)) % ranked.size();
  const auto chosen = ranked.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(ranked.begin(), chosen, ranked.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  return *chosen->second;
}

Vec3d Operator::start_of(const Action& action, const ObjectView& view) const {
  const Vec3d outwards = (view.rotation * action.direction).normalized();
  const Vec3d aim = aim_at(action, view);
  return aim + outwards * (exit_distance(view, aim, outwards) + settings_.clearance + user_.radius);
}

std::optional<session::Intent> Operator::first_intent(std::int64_t session_now_ns, const Objects& objects) {
  if (ticked_ns_ != 0 && session_now_ns - ticked_ns_ < settings_.period_ns) return std::nullopt;
  for (const Action& action : user_.script) {
    const ObjectView* const view = action.object.empty() ? nullptr : find_object(objects, action.object);
    if (view == nullptr) continue;
    ticked_ns_ = session_now_ns;
    const Vec3d start = start_of(action, *view);
    session::Intent intent;
    intent.user_id = user_id_;
    intent.sequence = ++sequence_;
    if (leans_) {  // starts in the orientation of the approach
      upright_ = (view->rotation * action.direction).normalized();
      base_ = orientation_ = ahead_ = Eigen::Quaterniond::FromTwoVectors(Vec3d::UnitZ(), upright_);
    }
    intent.path = {{session_now_ns, pose_of(start, orientation_)}};
    return intent;
  }
  return std::nullopt;
}

void Operator::plan_route(const Vec3d& to) {
  // Out to a sphere around the object, around it in straight pieces that keep clear, and in again to `to`.
  route_.clear();
  const double clear = view_.half.norm() + settings_.clearance + user_.radius;
  constexpr double kTurn = 0.8;  // rad per piece
  const double radius = clear / std::cos(kTurn / 2);
  const Vec3d from = hand_ - view_.centre;
  const Vec3d target = to - view_.centre;
  const Vec3d end = target.normalized();
  Vec3d begin = from.norm() > 1e-6 ? Vec3d(from.normalized()) : outwards_;
  const double angle = std::acos(std::clamp(begin.dot(end), -1.0, 1.0));
  route_.push_back(to);
  if (angle < 0.1 && from.norm() > target.norm()) return;
  const Vec3d tangent = angle < 3.1 ? Vec3d(end - begin * begin.dot(end)) : across(begin);
  const Vec3d side = tangent.norm() > 1e-6 ? Vec3d(tangent.normalized()) : across(begin);
  const int pieces = static_cast<int>(std::ceil(angle / kTurn));
  for (int i = pieces; i >= 0; --i) {
    const double arc = pieces > 0 ? angle * i / pieces : 0;
    route_.push_back(view_.centre + radius * (std::cos(arc) * begin + std::sin(arc) * side));
  }
  if (from.norm() > radius && angle > 0.1) route_.pop_back();
}

bool Operator::go_to(const Vec3d& target, double speed, double dt) {
  const Vec3d left = target - hand_;
  const double distance = left.norm();
  if (distance <= speed * dt) {
    hand_ = target;
    return true;
  }
  hand_velocity_ = left * (speed / distance);
  hand_ += hand_velocity_ * dt;
  return false;
}

void Operator::press_in(const Action& action, double dt) {
  if (touching() && !has_touched_) {
    has_touched_ = true;
    touched_ = proxy_;
  }
  const bool deep = action.depth > 0 && has_touched_ && (touched_ - device_).dot(outwards_) > action.depth;
  const double wanted = action.kind == ActionKind::kFollow ? 0.3 * action.force
                        : action.kind == ActionKind::kLift ? kLightTouch
                                                           : action.force;
  if (touching() && (deep || (action.depth == 0 && raw_force_ >= wanted))) {
    clock_ = 0;
    if (action.kind == ActionKind::kTap) {
      stage_ = Stage::kLiftOff;
    } else if (action.kind == ActionKind::kFollow) {
      start_following(action);
    } else if (action.kind == ActionKind::kLift) {
      start_gripping();
    } else if (action.kind == ActionKind::kGrab) {
      stage_ = Stage::kClose;
      buttons_ = haptics::kGrabButton;
      load_.setZero();
    } else {
      next_action();
    }
    return;
  }
  // Without this limit a hand that keeps pressing would build up an unlimited force.
  constexpr double kMaxLead = 0.08;
  if ((device_ - hand_).dot(outwards_) < kMaxLead) {
    hand_velocity_ = -outwards_ * (action.kind == ActionKind::kFollow ? 0.1 : action.speed);
    hand_ += hand_velocity_ * dt;
  }
  if ((start_ - device_).dot(outwards_) < depth_) return;
  ++tally_.approaches_missed;
  if (++attempts_ < kMaxAttempts) {
    stage_ = Stage::kBegin;
  } else {
    next_action();
  }
}

void Operator::lift_off(const Action& action, double dt) {
  constexpr double kLift = 0.015;
  const Vec3d up = touched_ + outwards_ * kLift;
  if (!go_to(up, action.speed, dt) || touching()) return;
  ++tally_.taps;
  clock_ = 0;
  has_touched_ = false;
  if (++taps_ < action.count) {
    stage_ = Stage::kPressIn;
  } else {
    next_action();
  }
}

void Operator::start_following(const Action& action) {
  stage_ = Stage::kFollow;
  clock_ = 0;
  lost_ = 0;
  cursor_ = touched_ = proxy_;
  push_ = std::max(0.0, (cursor_ - hand_).dot(normal_));
  const Vec3d side = across(outwards_);
  const double room = std::min(reach_along(view_, side), reach_along(view_, outwards_.cross(side)));
  extent_ = action.extent > 0 ? action.extent : room / 3;
  heading_ = 1;
  row_ = 0;
  row_step_ = extent_ / 5;
  plane_ = (proxy_ - view_.centre).dot(side);
}

Vec3d Operator::tangent(const Action& action) {
  const Vec3d side = across(outwards_);
  const Vec3d other = outwards_.cross(side);
  Vec3d wanted = side;
  switch (action.pattern) {
    case Pattern::kCircle: {
      const Vec3d from = proxy_ - touched_;
      const Vec3d flat = from - outwards_ * outwards_.dot(from);
      const double radius = flat.norm();
      const Vec3d radial = radius > 1e-6 ? Vec3d(flat / radius) : side;
      wanted = outwards_.cross(radial) * std::min(1.0, radius / extent_) + radial * (2 * (1 - radius / extent_));
      break;
    }
    case Pattern::kZigzag: {
      const Vec3d from = proxy_ - touched_;
      if (side.dot(from) * heading_ > extent_) {
        heading_ = -heading_;
        if (std::abs(row_ + row_step_) > extent_) row_step_ = -row_step_;
        row_ += row_step_;
      }
      wanted = side * heading_ + other * std::clamp(3 * (row_ - other.dot(from)) / extent_, -1.0, 1.0);
      break;
    }
    case Pattern::kAround: {
      const Vec3d from = proxy_ - view_.centre;
      wanted = side.cross(from).normalized() + side * ((plane_ - side.dot(from)) / std::max(from.norm(), 1e-6));
      break;
    }
  }
  const Vec3d along = wanted - normal_ * normal_.dot(wanted);
  constexpr double kMinAlong = 0.1;  // a share; on a steeper slope it moves across it
  if (along.norm() > kMinAlong * wanted.norm()) return along.normalized();
  return normal_.cross(side).norm() > 0.1 ? Vec3d(normal_.cross(side).normalized()) : normal_.cross(other).normalized();
}

void Operator::follow(const Action& action, double dt) {
  constexpr double kSettling = 0.12;   // s, time constant of the force control
  constexpr double kMaxPush = 0.08;    // m
  constexpr double kMaxAhead = 0.012;  // m that the cursor leads a blocked tip
  constexpr double kSeek = 0.05;       // m/s towards a lost surface
  tally_.following += dt;
  followed_ += dt;
  Vec3d drift = Vec3d::Zero();
  if (touching()) {
    lost_ = 0;
    const Vec3d ahead = cursor_ - proxy_;
    const Vec3d flat = ahead - normal_ * normal_.dot(ahead);
    const double length = flat.norm();
    cursor_ = proxy_ + (length > kMaxAhead ? Vec3d(flat * (kMaxAhead / length)) : flat);
    if (action.kind == ActionKind::kFollow) drift = tangent(action) * action.speed;
    push_ += (action.force - force_) / settings_.hand_stiffness * std::min(1.0, dt / kSettling);
    push_ = std::clamp(push_, 0.0, kMaxPush);
  } else {
    constexpr double kGap = 0.05;        // s; shorter losses are bounces
    constexpr double kStraightOn = 0.3;  // s along the normal, then towards the object
    constexpr double kGiveUp = 1.0;      // s, then a new approach
    if (lost_ < kGap && lost_ + dt >= kGap) ++tally_.contacts_lost;
    lost_ += dt;
    if (lost_ > kGiveUp) {
      stage_ = Stage::kBegin;
      return;
    }
    const Vec3d inwards =
        lost_ < kStraightOn ? Vec3d(-normal_) : Vec3d((nearest_of(view_, cursor_) - cursor_).normalized());
    drift = inwards * kSeek;
  }
  cursor_ += drift * dt;
  hand_ = cursor_ - normal_ * push_;
  hand_velocity_ = drift;
}

bool Operator::others_press(const Action& action, double force) const {
  constexpr std::int64_t kFresh = 200'000'000;
  const auto count = std::count_if(others_.begin(), others_.end(), [&](const auto& entry) {
    const Other& other = entry.second;
    return other.object == view_.id && other.force >= force && state_ns_ - other.received_ns < kFresh;
  });
  return count >= static_cast<std::ptrdiff_t>(action.others);
}

void Operator::start_gripping() {
  stage_ = Stage::kGrip;
  clock_ = both_ = lost_ = 0;
  gripped_ = device_;
  load_.setZero();
  push_ = std::max(0.0, (device_ - hand_).dot(outwards_));
}

/// Presses on the object with `force`.
void Operator::press_with(double force, double settling, double dt) {
  constexpr double kMaxPush = 0.08;  // m
  push_ += (force - felt_force_.dot(outwards_)) / settings_.hand_stiffness * std::min(1.0, dt / settling);
  push_ = std::clamp(push_, 0.0, kMaxPush);
}

void Operator::grip(const Action& action, double dt) {
  constexpr double kAll = 0.85;       // share of the force that each user has to reach
  constexpr double kSteady = 0.2;     // s for which they have to hold it
  constexpr double kGripping = 0.25;  // s
  lost_ = touching() ? 0 : lost_ + dt;
  if (lost_ > kLost) {
    ++tally_.lifts_lost;
    stage_ = Stage::kBegin;
    return;
  }
  // Alone it would push the object away, so it waits for the others.
  const bool together = others_press(action, 0.3 * kLightTouch);
  press_with(together ? action.force : kLightTouch, kGripping, dt);
  const bool pressed =
      together && felt_force_.dot(outwards_) > kAll * action.force && others_press(action, kAll * action.force);
  both_ = pressed ? both_ + dt : 0;
  hand_ = gripped_ - outwards_ * push_;
  if (both_ < kSteady) return;
  stage_ = Stage::kCarry;
  clock_ = 0;
}

void Operator::bear(const Vec3d& load, double within, double dt) {
  load_ += (load - load_) * std::min(1.0, dt / within);
}

/// Waits until the HRTC reports whether the hand holds the object.
void Operator::close_hand(double dt) {
  constexpr double kPatience = 0.5;  // s
  lost_ = touching() ? 0 : lost_ + dt;
  if (holding_) {
    ++tally_.grabs;
    next_action();
  } else if (refused_ || clock_ > kPatience) {
    ++tally_.grabs_refused;
    give_up_holding();
  }
}

/// Skips the actions that need a held object.
void Operator::give_up_holding() {
  buttons_ = 0;
  next_action();
}

void Operator::move_held(const Action& action, double dt) {
  constexpr double kBearing = 0.12;  // s
  lost_ = holding_ ? 0 : lost_ + dt;
  if (lost_ > kLost) {
    ++tally_.grabs_lost;
    return give_up_holding();
  }
  const double travel_time = action.by.norm() / action.speed * 1.5;  // s; the speed peaks in the middle
  const Vec3d before = hand_;
  bear(felt_force_, kBearing, dt);
  hand_ = gripped_ + action.by * (travel_time > 0 ? smooth(clock_ / travel_time) : 1.0) -
          load_ * (kShare / settings_.hand_stiffness);
  hand_velocity_ = (hand_ - before) / dt;
  if (clock_ >= travel_time + action.seconds) next_action();
}

void Operator::open_hand() {
  if (holding_ && clock_ < 1) return;
  route_ = {device_ + outwards_ * (settings_.clearance + user_.radius)};
  hand_ = device_;
  stage_ = Stage::kTravel;
  released_ = true;
}

/// Lifts, holds and lowers the object; the arm takes over the load that it measures.
void Operator::carry(const Action& action, double dt) {
  constexpr double kBearing = 1;    // s; a faster arm would excite the swinging of an object held by points
  constexpr double kKeeping = 0.5;  // s
  constexpr double kDown = 0.3;     // s on the ground before release
  lost_ = touching() ? 0 : lost_ + dt;
  if (lost_ > kLost) {
    ++tally_.lifts_lost;
    stage_ = Stage::kBegin;
    return;
  }
  const double travel_time = action.height / action.speed * 1.5;  // s; the speed peaks in the middle
  const double down = travel_time + action.seconds;
  const double raised = action.height * (smooth(clock_ / travel_time) - smooth((clock_ - down) / travel_time));
  press_with(action.force, kKeeping, dt);
  const Vec3d before = hand_;
  bear(felt_force_ - outwards_ * felt_force_.dot(outwards_), kBearing, dt);
  hand_ = gripped_ - outwards_ * push_ + Vec3d::UnitZ() * raised - load_ * (kShare / settings_.hand_stiffness);
  hand_velocity_ = (hand_ - before) / dt;
  if (clock_ < down + travel_time + kDown) return;
  ++tally_.lifts;
  route_ = {device_ + outwards_ * (settings_.clearance + user_.radius)};
  hand_ = device_;
  stage_ = Stage::kTravel;
  released_ = true;
}

}  // namespace tactus::client_sim
