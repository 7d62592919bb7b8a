/// Bodies whose surfaces are lists of triangles and whose poses a test sets.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "tests/haptics/triangle_surface.hpp"

namespace tactus::haptics::testing {

/// Transform from the frame of a body to the world frame; metres in both.
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
  /// Starts a step. A body rests in this step unless `move` is called for it.
  void start_step() {
    moving_ = false;
    for (Body& body : bodies_) body.previous_pose = body.pose;
  }
  void move(std::size_t body, const BodyPose& pose) {
    moving_ = true;
    bodies_[body].pose = pose;
  }

  [[nodiscard]] const BodyPose& pose(std::size_t body) const { return bodies_[body].pose; }

  [[nodiscard]] bool sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept override {
    return first_hit(from, to, radius, &Body::pose, hit);
  }
  [[nodiscard]] bool moving() const noexcept override { return moving_; }
  [[nodiscard]] bool sweep_moving(const Vec3d& from, const Vec3d& to, double radius,
                                  SurfaceHit& hit) noexcept override {
    return first_hit(from, to, radius, &Body::previous_pose, hit);
  }
  [[nodiscard]] Vec3d moved_point(std::uint32_t object, const Vec3d& point) const noexcept override {
    return bodies_[object].pose.to_world(bodies_[object].previous_pose.to_body(point));
  }
  [[nodiscard]] Vec3d rotated_direction(std::uint32_t object, const Vec3d& direction) const noexcept override {
    return bodies_[object].pose.rotation * (bodies_[object].previous_pose.rotation.transpose() * direction);
  }
  [[nodiscard]] bool closest(const Vec3d& point, double max_distance, SurfaceHit& hit) const noexcept override {
    bool found = false;
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      SurfaceHit candidate;
      const Body& body = bodies_[i];
      if (!body.surface.closest(body.pose.to_body(point), max_distance, candidate)) continue;
      if (found && std::abs(candidate.distance) >= std::abs(hit.distance)) continue;
      found = true;
      hit = to_world(candidate, i);
    }
    return found;
  }

 private:
  struct Body {
    TriangleSurface surface;
    BodyPose pose, previous_pose;  // at the end of the step, and at its start
  };
  [[nodiscard]] SurfaceHit to_world(SurfaceHit hit, std::size_t body) const {
    hit.point = bodies_[body].pose.to_world(hit.point);
    hit.normal = bodies_[body].pose.rotation * hit.normal;
    hit.object = static_cast<std::uint32_t>(body);
    return hit;
  }
  /// Finds the first contact of a sweep during which each body moves from `start_pose` to its present pose.
  [[nodiscard]] bool first_hit(const Vec3d& from, const Vec3d& to, double radius, BodyPose Body::*start_pose,
                               SurfaceHit& hit) {
    bool found = false;
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      SurfaceHit candidate;
      Body& body = bodies_[i];
      if (!body.surface.sweep((body.*start_pose).to_body(from), body.pose.to_body(to), radius, candidate)) continue;
      if (found && candidate.time >= hit.time) continue;
      found = true;
      hit = to_world(candidate, i);
    }
    return found;
  }

  std::vector<Body> bodies_;
  bool moving_ = false;
};

}  // namespace tactus::haptics::testing
