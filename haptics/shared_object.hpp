/// A shared object in one program, which simulates the object alone, as one of several copies, or not at all.
///
///     follow           another program simulates the object; the pose is the last one received
///     simulate_alone   this program simulates the object, with the probes of its own users
///     couple           several programs simulate a copy each, with the probes of their own users (coupling.hpp)
///
/// Hosts and HRTCs use this class. The ownership of the object decides the mode (session/ownership.hpp).
///
/// World frame, SI. One thread at a time. Realtime, except for the construction of a CopyCoupling.
#pragma once

#include <span>

#include "haptics/coupling.hpp"

namespace tactus::haptics {

/// The static geometry around a body.
struct Surroundings {
  bool ground = true;                      ///< there is a ground plane
  double ground_height = 0;                ///< m
  const SurfaceDistance* scene = nullptr;  ///< static objects, or null
};

/// A force whose impulse is `impulse` - `mass` * velocity, with the velocity at the end of the step
/// (RigidBody::add_implicit).
struct ImplicitForce {
  Mat6d mass = Mat6d::Zero();
  Vec6d impulse = Vec6d::Zero();
};

class SharedObject {
 public:
  explicit SharedObject(const BodySettings& whole, const BodyState& state = {}) noexcept
      : whole_{whole}, body_{whole, state} {}

  void follow() noexcept;
  void simulate_alone() noexcept;
  /// `coupling` must be for the same body, and must live until the next call of `follow`, `simulate_alone` or `couple`.
  void couple(CopyCoupling& coupling) noexcept;

  /// Sets the state of an object that another program simulates.
  void set_state(const BodyState& state) noexcept { body_.set_state(state); }
  /// Simulates one cycle of `dt` seconds. `springs`: of the probes that touch the object. `rotational_springs`: of the
  /// probes that hold it. `more`: a further force, null if there is none. Does nothing after `follow`.
  void step(std::int64_t now_ns, std::span<const PointSpring> springs, const Surroundings& surroundings, double dt,
            const ImplicitForce* more = nullptr, std::span<const RotationalSpring> rotational_springs = {}) noexcept;

  [[nodiscard]] const BodyState& state() const noexcept { return body_.state(); }
  [[nodiscard]] const RigidBody& body() const noexcept { return body_; }
  /// The coupling in use, or null.
  [[nodiscard]] CopyCoupling* coupling() noexcept { return coupling_; }
  [[nodiscard]] const CopyCoupling* coupling() const noexcept { return coupling_; }
  [[nodiscard]] const SolverResult& contacts() const noexcept { return solver_.last(); }
  /// Contacts with static geometry in the last step.
  [[nodiscard]] std::span<const Contact> static_contacts() const noexcept { return solver_.contacts(); }
  /// Returns whether the simulation pauses, because the object rests on a surface and no probe touches it. A coupled
  /// object never sleeps.
  [[nodiscard]] bool is_asleep() const noexcept { return rest_time_ >= kSleepAfter; }

 private:
  static constexpr double kRestSpeed = 5e-4;  // m/s, below which an object counts as at rest
  static constexpr double kSleepAfter = 0.3;  // s at rest

  BodySettings whole_;
  RigidBody body_;
  ContactSolver solver_;
  CopyCoupling* coupling_ = nullptr;
  bool following_ = false;
  double rest_time_ = 0;  // s at rest
};

}  // namespace tactus::haptics
