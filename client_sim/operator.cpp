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

constexpr double kTouch = 0.03;      // N; less is no contact to a user
constexpr double kSmoothing = 0.02;  // s, of what is felt
constexpr std::uint32_t kMaxAttempts = 5;
constexpr double kLightTouch = 0.5;  // N, at which an object waits for others to press
constexpr double kLost = 0.1;        // s without contact
constexpr double kShare = 0.9;       // of a load, that an arm comes to bear: more would answer itself

/// From 0 to 1 as `share` does, with no jump of the speed.
double smooth(double share) {
  const double s = std::clamp(share, 0.0, 1.0);
  return s * s * (3 - 2 * s);
}

Vec3d vector_of(const std::array<double, 3>& a) { return {a[0], a[1], a[2]}; }

session::Pose pose_of(const Vec3d& position, const Eigen::Quaterniond& turned) {
  return {{position.x(), position.y(), position.z()}, {turned.x(), turned.y(), turned.z(), turned.w()}};
}

/// How a hand leans after `seconds`, up to `most` each way about two axes and twice that about the tool's own.
Eigen::Quaterniond leaning(double max, double seconds) {
  constexpr double kTurn = 6.283185307179586;
  constexpr double kRates[3]{0.31, 0.23, 0.17};  // Hz, so that nothing comes again soon
  const auto swing = [&](int axis) { return std::sin(kTurn * kRates[axis] * seconds); };
  return haptics::exp_map(max * Vec3d{swing(0), swing(1), 2 * swing(2)});
}

/// A unit vector across `axis`, the same for the same axis.
Vec3d across(const Vec3d& axis) {
  const Vec3d helper = std::abs(axis.x()) < 0.7 ? Vec3d::UnitX() : Vec3d::UnitY();
  return (helper - axis * axis.dot(helper)).normalized();
}

/// The point of the surface that is nearest, as far as points are known; else the centre of the box.
Vec3d nearest_of(const ObjectView& view, const Vec3d& from) {
  const auto nearer = [&](const ObjectView::SurfacePoint& a, const ObjectView::SurfacePoint& b) {
    return (a.position - from).squaredNorm() < (b.position - from).squaredNorm();
  };
  const auto nearest = std::min_element(view.surface.begin(), view.surface.end(), nearer);
  return nearest == view.surface.end() ? view.centre : nearest->position;
}

/// How far the box reaches from its centre along a unit vector.
double reach_along(const ObjectView& view, const Vec3d& direction) {
  return (view.rotation.transpose() * direction).cwiseAbs().dot(view.half);
}

/// From a point inside the box to where a ray leaves it.
double way_out(const ObjectView& view, const Vec3d& from, const Vec3d& direction) {
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
  const Eigen::Quaterniond turn{entry.pose.orientation[3], entry.pose.orientation[0], entry.pose.orientation[1],
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
  view.rotation = turn.normalized().toRotationMatrix();
  view.centre = view.rotation * (entry.scale * centre) + vector_of(entry.pose.position);
  const auto vector = [](const std::array<float, 3>& a) { return Vec3d{double{a[0]}, double{a[1]}, double{a[2]}}; };
  for (const spm::SurfacePoint& point : entry.surface.points)
    view.surface.push_back({view.rotation * (entry.scale * vector(point.position)) + vector_of(entry.pose.position),
                            view.rotation * vector(point.normal)});
  view.spacing = entry.scale * entry.surface.spacing;
  return view;
}

const ObjectView* find_object(const Objects& objects, const std::string& reference) {
  if (const std::uint32_t place = place_of(reference); place > 0) {
    std::vector<const ObjectView*> fixed;
    for (const auto& [name, view] : objects)
      if (!view.moves) fixed.push_back(&view);
    return fixed.empty() ? nullptr : fixed[(place - 1) % fixed.size()];
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
  if (state.user_id != user_id_ || (felt_ && state.session_time_ns <= felt_ns_)) return;
  const Vec3d proxy = vector_of(state.proxy);
  const Vec3d force = vector_of(state.force);
  const double dt = felt_ ? static_cast<double>(state.session_time_ns - felt_ns_) * 1e-9 : 0;
  const double share = dt / (dt + kSmoothing);
  if (felt_ && dt > 0) travel_ += share * ((proxy - proxy_) / dt - travel_);
  device_ = vector_of(state.device.position);
  proxy_ = proxy;
  if (!felt_) hand_ = device_;
  felt_ = true;
  felt_ns_ = state.session_time_ns;
  felt_force_ += share * (force - felt_force_);
  raw_force_ = force.norm();
  force_ += share * (raw_force_ - force_);
  const bool contact = (state.status & session::kInContact) != 0 && raw_force_ > kTouch;
  if (contact) {
    // Friction tilts the force against the way the tip goes; the surface lies along that way.
    constexpr double kMoving = 0.01;
    Vec3d normal = force / raw_force_;
    if (travel_.norm() > kMoving && in_contact_) {
      const Vec3d way = travel_.normalized();
      const Vec3d upright = normal - way * way.dot(normal);
      constexpr double kMaxTilt = 0.7;  // cosine: beyond, it was no friction
      if (upright.norm() > kMaxTilt) normal = upright.normalized();
    }
    normal_ = in_contact_ ? Vec3d((normal_ + share * (normal - normal_)).normalized()) : normal;
  }
  in_contact_ = contact;
  holding_ = (state.status & session::kHolding) != 0;
  refused_ = (state.status & session::kHoldRefused) != 0;
}

void Operator::on_other(const session::ProbeState& state) {
  if (state.user_id == user_id_) return;
  others_[state.user_id] = {state.object_id, vector_of(state.force).norm(), felt_ns_};
}

std::optional<session::Intent> Operator::tick(std::int64_t session_now_ns, const Objects& objects) {
  if (!felt_) return first_wish(session_now_ns, objects);
  if (ticked_ns_ == 0) ticked_ns_ = session_now_ns - settings_.period_ns;
  if (session_now_ns - ticked_ns_ < settings_.period_ns) return std::nullopt;
  constexpr double kLongestStep = 0.05;  // after a pause the hand goes on, it does not catch up
  const double dt = std::min(kLongestStep, static_cast<double>(session_now_ns - ticked_ns_) * 1e-9);
  ticked_ns_ = session_now_ns;
  hand_velocity_.setZero();
  act(dt, objects);
  if (leans_) turn_hand(dt);

  session::Intent intent;
  intent.user_id = user_id_;
  intent.sequence = ++sequence_;
  intent.buttons = buttons_;
  const Vec3d ahead = hand_ + hand_velocity_ * (static_cast<double>(settings_.lookahead_ns) * 1e-9);
  intent.path = {{session_now_ns, pose_of(hand_, orientation_)},
                 {session_now_ns + settings_.lookahead_ns, pose_of(ahead, ahead_)}};
  return intent;
}

/// Upright on where the hand comes from, or on the surface that it follows, and off that as far as it leans.
void Operator::turn_hand(double dt) {
  constexpr double kWrist = 0.25;  // s, of what smooths
  const bool follows = stage_ == Stage::kFollow && !done_;
  const Vec3d before = upright_;
  upright_ = (upright_ + std::min(1.0, dt / kWrist) * ((follows ? normal_ : outwards_) - upright_)).normalized();
  base_ = (Eigen::Quaterniond::FromTwoVectors(before, upright_) * base_).normalized();  // without twist
  const double lean = follows ? user_.script[action_].lean : 0;
  const double lookahead = static_cast<double>(settings_.lookahead_ns) * 1e-9;
  const Eigen::Quaterniond from = orientation_, goal = base_ * leaning(lean, followed_);
  // No step where a lean ends.
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
      if (!go_to(way_.back(), speed, dt)) return;
      way_.pop_back();
      if (!way_.empty()) return;
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
  if (view == nullptr) return false;  // not there yet, or gone: wait for it
  const bool same_object = view->id == view_.id;
  view_ = *view;
  released_ = false;
  if (action.kind == ActionKind::kHold || (action.kind == ActionKind::kFollow && same_object && touching())) {
    start_following(action);
    return true;
  }
  if (action.kind == ActionKind::kRetreat) {
    way_ = {device_ + outwards_ * (way_out(view_, device_, outwards_) + settings_.clearance)};
    hand_ = device_;
    stage_ = Stage::kTravel;
    return true;
  }
  outwards_ = (view_.rotation * action.direction).normalized();
  const Vec3d aim = aim_at(action, view_);
  start_ = start_of(action, view_);
  depth_ = (start_ - aim).norm() + way_out(view_, aim, -outwards_) + settings_.clearance;
  hand_ = device_;
  plan_way(start_);
  has_touched_ = false;
  stage_ = Stage::kTravel;
  return true;
}

/// The point that the script names, unless a hand that comes along its direction misses the surface there: it does when
/// the line is further from all points of the surface than their spacing, or when an attempt has just shown it. Then
/// one of these points: near that line, and facing the hand. Each further attempt takes the next.
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
  return aim + outwards * (way_out(view, aim, outwards) + settings_.clearance + user_.radius);
}

std::optional<session::Intent> Operator::first_wish(std::int64_t session_now_ns, const Objects& objects) {
  if (ticked_ns_ != 0 && session_now_ns - ticked_ns_ < settings_.period_ns) return std::nullopt;
  for (const Action& action : user_.script) {
    const ObjectView* const view = action.object.empty() ? nullptr : find_object(objects, action.object);
    if (view == nullptr) continue;
    ticked_ns_ = session_now_ns;
    const Vec3d start = start_of(action, *view);
    session::Intent intent;
    intent.user_id = user_id_;
    intent.sequence = ++sequence_;
    if (leans_) {  // already as it will come
      upright_ = (view->rotation * action.direction).normalized();
      base_ = orientation_ = ahead_ = Eigen::Quaterniond::FromTwoVectors(Vec3d::UnitZ(), upright_);
    }
    intent.path = {{session_now_ns, pose_of(start, orientation_)}};
    return intent;
  }
  return std::nullopt;
}

void Operator::plan_way(const Vec3d& to) {
  // Out to a sphere around the object, around on it in straight pieces that stay clear, and in again to `to`.
  way_.clear();
  const double clear = view_.half.norm() + settings_.clearance + user_.radius;
  constexpr double kTurn = 0.8;  // rad a piece
  const double radius = clear / std::cos(kTurn / 2);
  const Vec3d from = hand_ - view_.centre;
  const Vec3d target = to - view_.centre;
  const Vec3d end = target.normalized();
  Vec3d begin = from.norm() > 1e-6 ? Vec3d(from.normalized()) : outwards_;
  const double angle = std::acos(std::clamp(begin.dot(end), -1.0, 1.0));
  way_.push_back(to);
  if (angle < 0.1 && from.norm() > target.norm()) return;
  const Vec3d tangent = angle < 3.1 ? Vec3d(end - begin * begin.dot(end)) : across(begin);
  const Vec3d side = tangent.norm() > 1e-6 ? Vec3d(tangent.normalized()) : across(begin);
  const int pieces = static_cast<int>(std::ceil(angle / kTurn));
  for (int i = pieces; i >= 0; --i) {
    const double turned = pieces > 0 ? angle * i / pieces : 0;
    way_.push_back(view_.centre + radius * (std::cos(turned) * begin + std::sin(turned) * side));
  }
  if (from.norm() > radius && angle > 0.1) way_.pop_back();
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
  // A hand that presses on and on would wind up; a fist pushes no further than this beyond where it is.
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
  Vec3d wish = side;
  switch (action.pattern) {
    case Pattern::kCircle: {
      const Vec3d from = proxy_ - touched_;
      const Vec3d flat = from - outwards_ * outwards_.dot(from);
      const double radius = flat.norm();
      const Vec3d radial = radius > 1e-6 ? Vec3d(flat / radius) : side;
      wish = outwards_.cross(radial) * std::min(1.0, radius / extent_) + radial * (2 * (1 - radius / extent_));
      break;
    }
    case Pattern::kZigzag: {
      const Vec3d from = proxy_ - touched_;
      if (side.dot(from) * heading_ > extent_) {
        heading_ = -heading_;
        if (std::abs(row_ + row_step_) > extent_) row_step_ = -row_step_;
        row_ += row_step_;
      }
      wish = side * heading_ + other * std::clamp(3 * (row_ - other.dot(from)) / extent_, -1.0, 1.0);
      break;
    }
    case Pattern::kAround: {
      const Vec3d from = proxy_ - view_.centre;
      wish = side.cross(from).normalized() + side * ((plane_ - side.dot(from)) / std::max(from.norm(), 1e-6));
      break;
    }
  }
  const Vec3d along = wish - normal_ * normal_.dot(wish);
  constexpr double kMinAlong = 0.1;  // of the wish; on a steeper slope it goes along that instead
  if (along.norm() > kMinAlong * wish.norm()) return along.normalized();
  return normal_.cross(side).norm() > 0.1 ? Vec3d(normal_.cross(side).normalized()) : normal_.cross(other).normalized();
}

void Operator::follow(const Action& action, double dt) {
  constexpr double kSettling = 0.12;   // s in which the force comes to the one asked for
  constexpr double kMaxPush = 0.08;    // m
  constexpr double kMaxAhead = 0.012;  // m that the cursor runs ahead of a tip that is held up
  constexpr double kSeek = 0.05;       // m/s towards a surface that is lost
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
    constexpr double kGap = 0.05;        // s: a hop, no loss
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
    return other.object == view_.id && other.force >= force && felt_ns_ - other.received_ns < kFresh;
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

/// Until the object is pressed so hard.
void Operator::press_with(double force, double settling, double dt) {
  constexpr double kMaxPush = 0.08;  // m
  push_ += (force - felt_force_.dot(outwards_)) / settings_.hand_stiffness * std::min(1.0, dt / settling);
  push_ = std::clamp(push_, 0.0, kMaxPush);
}

void Operator::grip(const Action& action, double dt) {
  constexpr double kAll = 0.85;       // of the force, that each has to come to
  constexpr double kSteady = 0.2;     // s for which they have to
  constexpr double kGripping = 0.25;  // s
  lost_ = touching() ? 0 : lost_ + dt;
  if (lost_ > kLost) {
    ++tally_.lifts_lost;
    stage_ = Stage::kBegin;
    return;
  }
  // Alone it would push the object away: so only once the others are there.
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

/// Until the controller says whether it has hold.
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

/// What the script would do with it is passed over.
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
  const double way = action.by.norm() / action.speed * 1.5;  // s; the fastest is in the middle
  const Vec3d before = hand_;
  bear(felt_force_, kBearing, dt);
  hand_ = gripped_ + action.by * (way > 0 ? smooth(clock_ / way) : 1.0) - load_ * (kShare / settings_.hand_stiffness);
  hand_velocity_ = (hand_ - before) / dt;
  if (clock_ >= way + action.seconds) next_action();
}

void Operator::open_hand() {
  if (holding_ && clock_ < 1) return;
  way_ = {device_ + outwards_ * (settings_.clearance + user_.radius)};
  hand_ = device_;
  stage_ = Stage::kTravel;
  released_ = true;
}

/// Up, for a while, and down again; the arm comes to bear what it feels.
void Operator::carry(const Action& action, double dt) {
  constexpr double kBearing = 1;    // s; what is held by points swings, and an arm that answered at once would drive it
  constexpr double kKeeping = 0.5;  // s
  constexpr double kDown = 0.3;     // s on the ground before it is let go
  lost_ = touching() ? 0 : lost_ + dt;
  if (lost_ > kLost) {
    ++tally_.lifts_lost;
    stage_ = Stage::kBegin;
    return;
  }
  const double way = action.height / action.speed * 1.5;  // s; the fastest is in the middle
  const double down = way + action.seconds;
  const double raised = action.height * (smooth(clock_ / way) - smooth((clock_ - down) / way));
  press_with(action.force, kKeeping, dt);
  const Vec3d before = hand_;
  bear(felt_force_ - outwards_ * felt_force_.dot(outwards_), kBearing, dt);
  hand_ = gripped_ - outwards_ * push_ + Vec3d::UnitZ() * raised - load_ * (kShare / settings_.hand_stiffness);
  hand_velocity_ = (hand_ - before) / dt;
  if (clock_ < down + way + kDown) return;
  ++tally_.lifts;
  way_ = {device_ + outwards_ * (settings_.clearance + user_.radius)};
  hand_ = device_;
  stage_ = Stage::kTravel;
  released_ = true;
}

}  // namespace tactus::client_sim
