#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "client_sim/operator.hpp"
#include "haptics/device.hpp"

namespace tactus::client_sim {

namespace {

constexpr std::uint32_t kMaxAttempts = 5;

}  // namespace

/// Returns the point at which an approach aims: the target point of the script in the first attempt. If the first
/// attempt has missed the surface, the second aims at the best surface point, and each further attempt at the next
/// best. Points are ranked by their distance from the line of the approach, and by how well their normals point to the
/// hand. If all surface points are further from this line than their spacing plus the probe's radius, the target point
/// would be missed, so the first attempt already aims at the best surface point.
Vec3d Operator::aim_point(const Action& action, const ObjectView& view) const {
  const Vec3d target = view.centre + view.rotation * ((2 * action.point - Vec3d::Ones()).cwiseProduct(view.half_size));
  if (view.surface.empty()) return target;
  const Vec3d outwards = (view.rotation * action.direction).normalized();
  double nearest = std::numeric_limits<double>::infinity();
  std::vector<std::pair<double, const Vec3d*>> ranked;
  for (const ObjectView::SurfacePoint& point : view.surface) {
    const Vec3d from = point.position - target;
    const double distance = (from - outwards * outwards.dot(from)).norm();
    nearest = std::min(nearest, distance);
    ranked.emplace_back(distance + view.spacing * (1 - outwards.dot(point.normal)), &point.position);
  }
  const bool may_hit = nearest <= view.spacing + user_.radius;
  if (may_hit && attempts_ == 0) return target;
  const std::size_t rank = (attempts_ - (may_hit ? 1 : 0)) % ranked.size();
  const auto chosen = ranked.begin() + static_cast<std::ptrdiff_t>(rank);
  std::nth_element(ranked.begin(), chosen, ranked.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  return *chosen->second;
}

Vec3d Operator::start_point(const Action& action, const ObjectView& view) const {
  const Vec3d outwards = (view.rotation * action.direction).normalized();
  const Vec3d aim = aim_point(action, view);
  return aim + outwards * (exit_distance(view, aim, outwards) + settings_.clearance + user_.radius);
}

/// Plans a route from the hand out to a sphere around the object, along that sphere in straight segments that do not
/// cross the object, and in to `to`.
void Operator::plan_route(const Vec3d& to) {
  route_.clear();
  const double min_distance = view_.half_size.norm() + settings_.clearance + user_.radius;
  constexpr double kMaxAngle = 0.8;  // rad, of one segment seen from the centre
  const double radius = min_distance / std::cos(kMaxAngle / 2);
  const Vec3d from = hand_ - view_.centre;
  const Vec3d target = to - view_.centre;
  const Vec3d end = target.normalized();
  Vec3d begin = from.norm() > 1e-6 ? Vec3d(from.normalized()) : outwards_;
  const double angle = std::acos(std::clamp(begin.dot(end), -1.0, 1.0));
  route_.push_back(to);
  if (angle < 0.1 && from.norm() > target.norm()) return;
  const Vec3d tangent = angle < 3.1 ? Vec3d(end - begin * begin.dot(end)) : perpendicular_to(begin);
  const Vec3d side = tangent.norm() > 1e-6 ? Vec3d(tangent.normalized()) : perpendicular_to(begin);
  const int segments = static_cast<int>(std::ceil(angle / kMaxAngle));
  for (int i = segments; i >= 0; --i) {
    const double arc = segments > 0 ? angle * i / segments : 0;
    route_.push_back(view_.centre + radius * (std::cos(arc) * begin + std::sin(arc) * side));
  }
  if (from.norm() > radius && angle > 0.1) route_.pop_back();
}

void Operator::approach(const Action& action, double dt) {
  if (is_touching() && !has_first_contact_) {
    has_first_contact_ = true;
    first_contact_ = proxy_;
  }
  const bool is_deep =
      action.depth > 0 && has_first_contact_ && (first_contact_ - device_).dot(outwards_) > action.depth;
  const double target_force = action.kind == ActionKind::kFollow ? 0.3 * action.force
                              : action.kind == ActionKind::kLift ? kWaitingForce
                                                                 : action.force;
  if (is_touching() && (is_deep || (action.depth == 0 && force_norm_ >= target_force))) {
    stage_time_ = 0;
    if (action.kind == ActionKind::kTap) {
      stage_ = Stage::kPullBack;
    } else if (action.kind == ActionKind::kFollow) {
      start_following(action);
    } else if (action.kind == ActionKind::kLift) {
      start_lift();
    } else if (action.kind == ActionKind::kGrab) {
      stage_ = Stage::kGrab;
      buttons_ = haptics::kGrabButton;
      load_.setZero();
    } else {
      next_action();
    }
    return;
  }
  // Max distance of the hand from the device. Without it, the hand's force on a blocked device would grow without
  // bound.
  constexpr double kMaxLead = 0.08;  // m
  if ((device_ - hand_).dot(outwards_) < kMaxLead) {
    constexpr double kFollowApproachSpeed = 0.1;  // m/s; `speed` of a follow action is that along the surface
    hand_velocity_ = -outwards_ * (action.kind == ActionKind::kFollow ? kFollowApproachSpeed : action.speed);
    hand_ += hand_velocity_ * dt;
  }
  if ((approach_start_ - device_).dot(outwards_) < max_travel_) return;
  ++tally_.approaches_missed;
  if (++attempts_ < kMaxAttempts) {
    stage_ = Stage::kPlan;
  } else {
    next_action();
  }
}

/// The direction of a retreat, a unit vector. After `follow`, the hand may be on another side than that of the approach.
Vec3d Operator::way_out() const {
  if (is_touching()) return normal_;
  const Vec3d from_centre = device_ - view_.centre;
  return from_centre.dot(outwards_) >= 0 ? outwards_ : Vec3d(from_centre.normalized());
}

void Operator::pull_back(const Action& action, double dt) {
  constexpr double kDistance = 0.015;  // m
  if (!move_hand_towards(first_contact_ + outwards_ * kDistance, action.speed, dt) || is_touching()) return;
  ++tally_.taps;
  stage_time_ = 0;
  has_first_contact_ = false;
  if (++taps_ < action.count) {
    stage_ = Stage::kApproach;
  } else {
    next_action();
  }
}

}  // namespace tactus::client_sim
