/// A shared object as one program simulates it: alone, as one of several copies, or not at all.
///
///     follow    another program simulates it; its pose is the last one received
///     own       this program simulates it, with the probes that touch it here
///     couple    several programs simulate it, each with its own users' probes (coupling.hpp)
///
/// Host and HRTC use the same class; the present owner decides the mode (session/ownership.hpp). A host that never
/// gives up an object is the server-authoritative form.
///
/// World frame, SI. One thread at a time. Realtime, except for making a CopyCoupling, which fills histories.
#pragma once

#include <span>

#include "haptics/coupling.hpp"

namespace tactus::haptics {

struct Surroundings {
  bool ground = true;
  double ground_height = 0;
  const SurfaceDistance* scene = nullptr;  ///< static geometry, or null
};

/// A force on a body beside its springs: the impulse `impulse` - `mass` * velocity.
struct ImplicitForce {
  Mat6d mass = Mat6d::Zero();
  Vec6d impulse = Vec6d::Zero();
};

class SharedObject {
 public:
  explicit SharedObject(const BodySettings& whole, const BodyState& state = {}) noexcept
      : whole_{whole}, body_{whole, state} {}

  void follow() noexcept;
  void own() noexcept;
  /// `coupling` must be for the same body and must outlive its use here, until the next call of one of these three.
  void couple(CopyCoupling& coupling) noexcept;

  /// Sets its pose while another program simulates it.
  void place(const BodyState& state) noexcept { body_.place(state); }
  /// One cycle. `springs`: of probes that touch it; `rotational_springs`: of probes that hold it. Does nothing while
  /// following.
  void step(std::int64_t now_ns, std::span<const PointSpring> springs, const Surroundings& surroundings, double dt,
            const ImplicitForce* more = nullptr, std::span<const RotationalSpring> rotational_springs = {}) noexcept;

  [[nodiscard]] const BodyState& state() const noexcept { return body_.state(); }
  [[nodiscard]] const RigidBody& body() const noexcept { return body_; }
  /// Null unless coupled.
  [[nodiscard]] CopyCoupling* coupling() noexcept { return coupling_; }
  [[nodiscard]] const CopyCoupling* coupling() const noexcept { return coupling_; }
  [[nodiscard]] const SolverResult& contacts() const noexcept { return solver_.last(); }
  /// Contacts with static geometry in the last step.
  [[nodiscard]] std::span<const Contact> static_contacts() const noexcept { return solver_.contacts(); }
  /// True for an owned object that rests on something and that nobody touches; it does not move until that changes.
  [[nodiscard]] bool asleep() const noexcept { return still_ >= kStill; }

 private:
  static constexpr double kRestSpeed = 5e-4;  // m/s
  static constexpr double kStill = 0.3;       // s

  BodySettings whole_;
  RigidBody body_;
  ContactSolver solver_;
  CopyCoupling* coupling_ = nullptr;
  bool following_ = false;
  double still_ = 0;  // s since it moved
};

}  // namespace tactus::haptics
