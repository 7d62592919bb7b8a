/// Passivity controller: observes the energy at a hand's port and limits the force so that the energy stays positive,
/// except for PassivitySettings::allowance.
///
/// A force that is constant during a cycle does the work force * displacement on the hand. So the port's energy is
/// known exactly at each pose:
///
///     E_n = E_(n-1) - F_(n-1) . (x_n - x_(n-1)) - W_n        energy received from the hand minus energy passed on
///
/// F is the force on the hand and x the position of the device, at pose n. W_n is the work on a touched body since the
/// previous pose; it is zero for a fixed surface. If energy of another user returns through the body, W_n is negative.
///
/// The passivity controller predicts one cycle. It assumes that the next displacement is the present one plus the
/// maximum acceleration of a hand in the direction of the force. It reduces a force that would then give the hand more
/// than E. So it acts when a hand has nearly left a surface: by then a sampled spring has returned more energy than it
/// received. Damping removes any remaining deficit.
///
/// Limits: below a minimum speed there is no damping. The damping is at most m / T, with the device's mass m and the
/// cycle T, because a sampled damper above 2 m / T is unstable. Energy above a bound is discarded. Otherwise the energy
/// of a long passive phase would hide a later active phase. Input that is not finite causes no force and no energy.
///
/// World or device frame, SI. One thread at a time. Realtime.
/// Source: Hannaford, Ryu 2002 (time domain passivity control); Stramigioli et al. 2005 (exact energy of a force
/// that is constant during a cycle).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "spm/model.hpp"

namespace tactus::haptics {

using spm::Vec3d;

struct PassivitySettings {
  double allowance = 5e-7;   ///< J, maximum deficit of E; without it no motion could start
  double acceleration = 50;  ///< m/s^2, maximum acceleration of a hand within a cycle
  double credit = 0.05;      ///< J, maximum of E minus the energy that is stored in a spring at the port
  double min_speed = 1e-3;   ///< m/s, minimum speed for damping
  double device_mass = 0.1;  ///< kg, minimum mass m of a device; limits the damping to m / T
};

class PassivityController {
 public:
  explicit PassivityController(const PassivitySettings& settings = {}) noexcept : settings_{settings} {}

  /// Clears all state; the next pose is the first.
  void reset() noexcept { *this = PassivityController{settings_}; }

  /// Computes one cycle. `force`: force wanted on the hand. `position`: of the device. `passed_on`: work on a body
  /// since the previous cycle, J. Returns the force to exert until the next cycle. If `control` is false, observes the
  /// energy and returns `force`. `stored`: J that the spring returns when hand and body separate; this part of E is not
  /// discarded.
  [[nodiscard]] Vec3d step(const Vec3d& force, const Vec3d& position, double passed_on, double dt, bool control = true,
                           double stored = 0) noexcept;
  /// Returns E at the next pose, as `step` would count it, and leaves the account unchanged.
  [[nodiscard]] double energy_at(const Vec3d& position, double passed_on) const noexcept {
    return ledger_.energy - (started_ ? force_.dot(position - position_) : 0.0) - passed_on;
  }
  /// Sets the force that the hand received, if it differs from the result of `step`.
  void limited(const Vec3d& force) noexcept { force_ = force; }

  struct Ledger {
    double energy = 0;                 ///< J, E
    double lowest = 0;                 ///< J, minimum of E
    double withheld = 0;               ///< J that the withheld force would have given
    double discarded = 0;              ///< J discarded above the bound
    std::uint64_t withholding = 0;     ///< cycles with a reduced force
    std::uint64_t damping = 0;         ///< cycles with damping
    std::uint64_t invalid_inputs = 0;  ///< cycles whose input was not finite
  };
  [[nodiscard]] const Ledger& ledger() const noexcept { return ledger_; }

 private:
  PassivitySettings settings_;
  Ledger ledger_;
  Vec3d position_ = Vec3d::Zero(), force_ = Vec3d::Zero();
  bool started_ = false;
};

/// A spring with a limited force: min(stiffness * stretch, max_force). Rotational springs have N m/rad, N m and rad.
struct LimitedSpring {
  double stiffness = 0;  ///< N/m
  double max_force = 0;  ///< N

  [[nodiscard]] double force(double stretch) const noexcept { return std::min(stiffness * stretch, max_force); }
  /// Returns the energy in the spring, J.
  [[nodiscard]] double energy(double stretch) const noexcept {
    const double linear = std::min(stretch, max_linear());
    return 0.5 * stiffness * linear * linear + max_force * (stretch - linear);
  }
  /// The inverse of `energy`. Returns the stretch, m. The stiffness must be above 0.
  [[nodiscard]] double stretch(double energy) const noexcept {
    const double linear = max_linear(), at_limit = 0.5 * stiffness * linear * linear;
    return energy <= at_limit ? std::sqrt(2 * energy / stiffness) : linear + (energy - at_limit) / max_force;
  }

 private:
  /// Stretch at which the force reaches its limit, m.
  [[nodiscard]] double max_linear() const noexcept { return max_force / std::max(stiffness, 1e-9); }
};

/// Limits the spring between hand and body when it regains its strength, so that it gains no energy.
///
/// A spring loses strength when poses are stale. Meanwhile hand and body may move apart without a force. If the spring
/// then had its full strength and length at once, no hand would have supplied its energy. So a rise may use only the
/// energy that earlier falls in the same contact have released, or the part of the port's E above the energy of the
/// spring. If this is too little, the spring gets a rest length: hand and body stay apart by this length. The spring
/// keeps its whole stiffness, so a hand that pushes on feels the body as stiff as before, only deeper. The rest length
/// ends when the hand moves back, or when there is energy for it.
///
/// SI. One thread at a time. Realtime.
class SpringLimiter {
 public:
  /// Begins a contact. The first `step` does not limit its spring.
  void reset() noexcept { *this = {}; }
  /// Call this in a cycle in which the tip or tool does not touch the body, perhaps because of a bounce. If the
  /// distance has grown at the next `step`, a rest length grows with it. More than kMaxInterruption such cycles end the
  /// contact.
  void interrupt() noexcept {
    constexpr int kMaxInterruption = 100;  // cycles
    if (++interruption_ > kMaxInterruption) reset();
  }

  /// Returns the rest length until the next cycle, 0 to `length`. `strength`: share of the force of `spring` that acts
  /// until the next cycle, 0 to 1; `length`: distance of hand and body, m; `energy`: E of their port, J.
  [[nodiscard]] double step(double strength, const LimitedSpring& spring, double length, double energy) noexcept {
    constexpr double kFree = 5e-7;  // J, energy of a short spring, which is not counted
    const double whole = spring.energy(length);
    if (std::exchange(interruption_, 0) > 0 && rest_length_ > 0) rest_length_ += std::max(0.0, length - length_);
    length_ = length;
    if (!has_strength_ || whole <= kFree) {
      has_strength_ = true;
      released_ = whole <= kFree ? 0 : released_;
      strength_ = strength;
      return rest_length_ = 0;
    }
    rest_length_ = std::min(rest_length_, length);
    const double before = strength_ * spring.energy(length - rest_length_);
    const double max_energy = before + std::max({0.0, released_, energy - before});
    const double after = std::min(strength * whole, max_energy);
    // Where `max_energy` is the smaller one, the strength is above 0.
    rest_length_ = after < strength * whole ? std::max(0.0, length - spring.stretch(after / strength)) : 0;
    released_ = std::max(0.0, released_ - (after - before));
    strength_ = strength;
    return rest_length_;
  }

 private:
  bool has_strength_ = false;
  int interruption_ = 0;              // cycles since the last step
  double strength_ = 0, length_ = 0;  // of the last step
  double rest_length_ = 0;            // m
  double released_ = 0;               // J, released by falls of the strength and not used by a rise
};

}  // namespace tactus::haptics
