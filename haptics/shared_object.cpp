#include "haptics/shared_object.hpp"

namespace tactus::haptics {

void SharedObject::follow() noexcept {
  coupling_ = nullptr;
  body_.change(whole_);
  following_ = true;
}

void SharedObject::simulate_alone() noexcept {
  coupling_ = nullptr;
  body_.change(whole_);
  following_ = false;
  rest_time_ = 0;
}

void SharedObject::couple(CopyCoupling& coupling) noexcept {
  coupling_ = &coupling;
  body_.change(coupling_->body_settings());
  following_ = false;
  rest_time_ = 0;
}

void SharedObject::step(std::int64_t now_ns, std::span<const PointSpring> springs, const Surroundings& surroundings,
                        double dt, const ImplicitForce* more,
                        std::span<const RotationalSpring> rotational_springs) noexcept {
  if (following_) return;
  if (!springs.empty() || more != nullptr) rest_time_ = 0;
  if (is_asleep()) return;

  const Vec3d centre = body_.state().position;
  body_.begin(dt);
  for (const PointSpring& spring : springs) body_.add_spring(spring);
  for (const RotationalSpring& spring : rotational_springs) body_.add_spring(spring);
  if (more != nullptr) body_.add_implicit(more->mass, more->impulse);
  if (coupling_ != nullptr) coupling_->begin(now_ns, dt, body_);
  SolverBody moving = body_.free_motion();
  solver_.begin();
  if (surroundings.ground) add_ground_contacts(body_, 0, surroundings.ground_height, solver_);
  if (surroundings.scene != nullptr) add_surface_contacts(body_, 0, *surroundings.scene, solver_);
  const bool supported = solver_.solve({&moving, 1}, dt).contacts > 0;
  body_.finish(moving.velocity);
  if (coupling_ != nullptr) {
    Vec3d user_force = Vec3d::Zero();
    for (const PointSpring& spring : springs) {
      const Vec3d arm = spring.point - centre;
      user_force += spring.force(moving.velocity.head<3>() + moving.velocity.tail<3>().cross(arm), dt);
    }
    coupling_->finish(moving.velocity, body_, user_force);
  }

  const bool may_sleep = supported && springs.empty() && more == nullptr && coupling_ == nullptr;
  rest_time_ = may_sleep && body_.top_speed() < kRestSpeed ? rest_time_ + dt : 0;
  if (is_asleep()) body_.stop();
}

}  // namespace tactus::haptics
