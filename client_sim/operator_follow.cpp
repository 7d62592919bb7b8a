#include <algorithm>
#include <cmath>

#include "client_sim/operator.hpp"

namespace tactus::client_sim {

void Operator::start_following(const Action& action) {
  stage_ = Stage::kFollow;
  stage_time_ = 0;
  loss_time_ = 0;
  cursor_ = first_contact_ = proxy_;
  push_depth_ = std::max(0.0, (cursor_ - hand_).dot(normal_));
  const Vec3d side = perpendicular_to(outwards_);
  const double max_extent = std::min(half_extent_along(view_, side), half_extent_along(view_, outwards_.cross(side)));
  extent_ = action.extent > 0 ? action.extent : max_extent / 3;
  heading_ = 1;
  row_ = 0;
  row_step_ = extent_ / 5;
  plane_offset_ = (proxy_ - view_.centre).dot(side);
}

/// Returns the direction of motion, a unit vector along the surface. For a zigzag, also starts a new row where one
/// ends.
Vec3d Operator::tangent(const Action& action) {
  const Vec3d side = perpendicular_to(outwards_);
  const Vec3d other = outwards_.cross(side);
  Vec3d wanted = side;
  switch (action.pattern) {
    case Pattern::kCircle: {
      const Vec3d from = proxy_ - first_contact_;
      const Vec3d flat = from - outwards_ * outwards_.dot(from);
      const double radius = flat.norm();
      const Vec3d radial = radius > 1e-6 ? Vec3d(flat / radius) : side;
      wanted = outwards_.cross(radial) * std::min(1.0, radius / extent_) + radial * (2 * (1 - radius / extent_));
      break;
    }
    case Pattern::kZigzag: {
      const Vec3d from = proxy_ - first_contact_;
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
      wanted = side.cross(from).normalized() + side * ((plane_offset_ - side.dot(from)) / std::max(from.norm(), 1e-6));
      break;
    }
  }
  const Vec3d along = wanted - normal_ * normal_.dot(wanted);
  constexpr double kMinAlong = 0.1;  // min share of `wanted` along the surface; below it, moves across the slope
  if (along.norm() > kMinAlong * wanted.norm()) return along.normalized();
  return normal_.cross(side).norm() > 0.1 ? Vec3d(normal_.cross(side).normalized()) : normal_.cross(other).normalized();
}

void Operator::follow(const Action& action, double dt) {
  constexpr double kForceTime = 0.12;     // s, time constant of the force control
  constexpr double kMaxPushDepth = 0.08;  // m
  constexpr double kMaxAhead = 0.012;     // m, max distance of the cursor from a proxy that is blocked
  constexpr double kSearchSpeed = 0.05;   // m/s, towards a lost surface
  tally_.following += dt;
  followed_time_ += dt;
  Vec3d cursor_velocity = Vec3d::Zero();
  if (is_touching()) {
    loss_time_ = 0;
    const Vec3d ahead = cursor_ - proxy_;
    const Vec3d flat = ahead - normal_ * normal_.dot(ahead);
    const double length = flat.norm();
    cursor_ = proxy_ + (length > kMaxAhead ? Vec3d(flat * (kMaxAhead / length)) : flat);
    if (action.kind == ActionKind::kFollow) cursor_velocity = tangent(action) * action.speed;
    push_depth_ += (action.force - smoothed_norm_) / settings_.hand_stiffness * std::min(1.0, dt / kForceTime);
    push_depth_ = std::clamp(push_depth_, 0.0, kMaxPushDepth);
  } else {
    constexpr double kMaxBounce = 0.05;  // s; a longer loss counts as lost contact
    constexpr double kSearchAlongNormal =
        0.3;                            // s of search along the normal, before the search towards surface points
    constexpr double kMaxSearch = 1.0;  // s; then a new approach begins
    if (loss_time_ < kMaxBounce && loss_time_ + dt >= kMaxBounce) ++tally_.contacts_lost;
    loss_time_ += dt;
    if (loss_time_ > kMaxSearch) {
      stage_ = Stage::kPlan;
      return;
    }
    const Vec3d inwards = loss_time_ < kSearchAlongNormal
                              ? Vec3d(-normal_)
                              : Vec3d((nearest_surface_point(view_, cursor_) - cursor_).normalized());
    cursor_velocity = inwards * kSearchSpeed;
  }
  cursor_ += cursor_velocity * dt;
  hand_ = cursor_ - normal_ * push_depth_;
  hand_velocity_ = cursor_velocity;
}

}  // namespace tactus::client_sim
