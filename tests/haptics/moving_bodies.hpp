/// Bodies of plain triangle lists at poses that a test sets.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "tests/haptics/triangle_surface.hpp"

namespace tactus::haptics::testing {

/// From a body's frame to the world; metres in both.
struct BodyPose {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Vec3d position = Vec3d::Zero();
  [[nodiscard]] Vec3d to_world(const Vec3d& p) const { return rotation * p + position; }
  [[nodiscard]] Vec3d to_body(const Vec3d& p) const { return rotation.transpose() * (p - position); }
};

class MovingBodies final : public Surface {
 public:
  void add(std::vector<Triangle> triangles, const BodyPose& pose = {}) {
    bodies_.push_back({TriangleSurface{std::move(triangles)}, pose, pose});
  }
  /// Starts a step in which only the bodies moved after this call are in motion.
  void rest() {
    moving_ = false;
    for (Body& body : bodies_) body.before = body.now;
  }
  void move(std::size_t body, const BodyPose& pose) {
    moving_ = true;
    bodies_[body].now = pose;
  }

  [[nodiscard]] std::size_t count() const { return bodies_.size(); }
  [[nodiscard]] const BodyPose& pose(std::size_t body) const { return bodies_[body].now; }
  [[nodiscard]] const std::vector<Triangle>& triangles(std::size_t body) const {
    return bodies_[body].surface.triangles();
  }

  [[nodiscard]] bool sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept override {
    return earliest(from, to, radius, &Body::now, hit);
  }
  [[nodiscard]] bool moving() const noexcept override { return moving_; }
  [[nodiscard]] bool sweep_moving(const Vec3d& from, const Vec3d& to, double radius,
                                  SurfaceHit& hit) noexcept override {
    return earliest(from, to, radius, &Body::before, hit);
  }
  [[nodiscard]] Vec3d moved_point(std::uint32_t object, const Vec3d& point) const noexcept override {
    return bodies_[object].now.to_world(bodies_[object].before.to_body(point));
  }
  [[nodiscard]] Vec3d rotated_direction(std::uint32_t object, const Vec3d& direction) const noexcept override {
    return bodies_[object].now.rotation * (bodies_[object].before.rotation.transpose() * direction);
  }
  [[nodiscard]] bool closest(const Vec3d& point, double within, SurfaceHit& hit) const noexcept override {
    bool found = false;
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      SurfaceHit touch;
      const Body& body = bodies_[i];
      if (!body.surface.closest(body.now.to_body(point), within, touch)) continue;
      if (found && std::abs(touch.distance) >= std::abs(hit.distance)) continue;
      found = true;
      hit = to_world(touch, i);
    }
    return found;
  }

 private:
  struct Body {
    TriangleSurface surface;
    BodyPose now, before;
  };
  [[nodiscard]] SurfaceHit to_world(SurfaceHit hit, std::size_t body) const {
    hit.point = bodies_[body].now.to_world(hit.point);
    hit.normal = bodies_[body].now.rotation * hit.normal;
    hit.object = static_cast<std::uint32_t>(body);
    return hit;
  }
  [[nodiscard]] bool earliest(const Vec3d& from, const Vec3d& to, double radius, BodyPose Body::*begin,
                              SurfaceHit& hit) {
    bool found = false;
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      SurfaceHit touch;
      Body& body = bodies_[i];
      if (!body.surface.sweep((body.*begin).to_body(from), body.now.to_body(to), radius, touch)) continue;
      if (found && touch.time >= hit.time) continue;
      found = true;
      hit = to_world(touch, i);
    }
    return found;
  }

  std::vector<Body> bodies_;
  bool moving_ = false;
};

}  // namespace tactus::haptics::testing
