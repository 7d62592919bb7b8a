/// Passivity controller: observes the energy at a hand's port and limits the force so that the energy stays above zero.
///
/// A force that is constant during a cycle does the work force * displacement on the hand. So the port's energy is
/// known exactly at each pose:
///
///     E_n = E_(n-1) - F_(n-1) . (x_n - x_(n-1)) - W_n        energy received from the hand minus energy passed on
///
/// F is the force on the hand and x the position of the device, at pose n. W_n is the work on a touched body since the
/// previous pose; it is zero for a fixed surface. If energy of another user returns through the body, W_n is negative.
///
/// The passivity controller predicts one cycle. It reduces a force that would give the hand more than E, either with
/// the present motion or with a motion that the hand may begin within the cycle. So it acts when a hand has nearly left
/// a surface: by then a sampled spring has returned more energy than it received. Damping removes any remaining
/// deficit.
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
#include <cstdint>

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

/// Limits how fast a spring between hand and body regains its strength, so that it gains no energy.
///
/// A spring loses strength when poses are old. Meanwhile hand and body may move apart without a force. If the spring
/// then had its full strength at once, no hand would have supplied its energy. So a rise costs the energy
///
///     (strength - strength before) * stored energy of the full spring
///
/// and may use the energy that earlier falls in the same contact have released, or the part of the port's E above the
/// energy of the spring. Without either, the spring stays weak until the hand approaches the body, where the spring is
/// short and a rise costs little.
///
/// SI. One thread at a time. Realtime.
class StrengthLimiter {
 public:
  /// Begins a contact, whose first strength is not limited.
  void reset() noexcept { *this = {}; }

  /// Returns the strength of the spring until the next cycle, 0 to `wanted`. `wanted`: strength before this limit, 0 to
  /// 1; `stored`: energy of the spring at full strength, J; `energy`: E of its port, J.
  [[nodiscard]] double step(double wanted, double stored, double energy) noexcept {
    constexpr double kFree = 5e-7;  // J, energy of a short spring, which is not counted
    if (!has_strength_ || stored <= kFree) {
      has_strength_ = true;
      released_ = stored <= kFree ? 0 : released_;
      return strength_ = wanted;
    }
    const double cost = (wanted - strength_) * stored;
    const double available = std::max({0.0, released_, energy - strength_ * stored});
    if (cost > available) wanted = strength_ + available / stored;
    released_ = std::max(0.0, released_ - (wanted - strength_) * stored);
    return strength_ = wanted;
  }

 private:
  bool has_strength_ = false;
  double strength_ = 0;  // of the last cycle
  double released_ = 0;  // J, released by falls of the strength and not used by a rise
};

}  // namespace tactus::haptics
