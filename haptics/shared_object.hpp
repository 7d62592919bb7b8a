/// A shared object as one program simulates it: alone, as one of several copies, or not at all.
///
///     follow    somebody else simulates it; it stands where the last pose says
///     own       this program does, with whatever probes touch it here
///     couple    several do, each with its own users' probes (coupling.hpp)
///
/// Host and controllers use the same: who does what says the owner of the moment (session/ownership.hpp). A host that
/// never gives an object away is the server-authoritative form.
///
/// World frame, SI. One thread at a time. Realtime; a coupling is made elsewhere, because that fills histories.
#pragma once

#include "haptics/coupling.hpp"

namespace tactus::haptics {

struct Surroundings {
  bool ground = true;
  double ground_height = 0;
  const SurfaceDistance* scene = nullptr;  ///< static geometry, or null
};

/// What acts on a body beside its springs: the impulse `impulse` - `mass` * velocity.
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
  /// `coupling`, made for the same body, must outlive what follows until the next of these three.
  void couple(CopyCoupling& coupling) noexcept;

  /// Where it is while another simulates it.
  void place(const BodyState& state) noexcept { body_.place(state); }
  /// One cycle; `springs` of the probes that touch it, `turns` of those that hold it. Does nothing while following.
  void step(std::int64_t now_ns, spm::Span<const PointSpring> springs, const Surroundings& surroundings, double dt,
            const ImplicitForce* more = nullptr, spm::Span<const TorsionSpring> turns = {}) noexcept;

  [[nodiscard]] const BodyState& state() const noexcept { return body_.state(); }
  [[nodiscard]] const RigidBody& body() const noexcept { return body_; }
  /// Null unless coupled.
  [[nodiscard]] CopyCoupling* coupling() noexcept { return coupling_; }
  [[nodiscard]] const CopyCoupling* coupling() const noexcept { return coupling_; }
  [[nodiscard]] const SolverResult& contacts() const noexcept { return solver_.last(); }
  /// With what does not move, of the last step: all that it may have touched in it.
  [[nodiscard]] spm::Span<const Contact> static_contacts() const noexcept { return solver_.contacts(); }
  /// Owned, at rest on something and touched by nobody: it is not moved until that changes.
  [[nodiscard]] bool asleep() const noexcept { return still_ >= kStill; }

 private:
  static constexpr double kRestSpeed = 5e-4;  // m/s
  static constexpr double kStill = 0.3;       // s

  BodySettings whole_;
  RigidBody body_;
  ContactSolver solver_;
  CopyCoupling* coupling_ = nullptr;
  bool following_ = false;
  double still_ = 0;  // s for which it has hardly moved
};

}  // namespace tactus::haptics
