/// Passivity controller: counts the energy at a hand's port and keeps it at or above zero.
///
/// A force that is held for a cycle does exactly force * displacement of work on the hand. So the port's energy is
/// known exactly at each pose:
///
///     E_n = E_(n-1) - F_(n-1) . (x_n - x_(n-1)) - W_n        energy taken from the hand minus energy passed on
///
/// with W_n the work on other bodies (a pushed body; zero for a fixed surface). Energy that another user put into a
/// body may come back: then W_n < 0. The passivity controller looks one cycle ahead. It reduces a force that would draw
/// more than E with the present motion, or with a motion that the hand may begin within the cycle. So it acts at the
/// end of a release, where a sampled spring returns more than it took. Damping repays any remaining deficit.
///
/// Guards: no damping below a minimum speed, and none beyond the device's limit (2 m / T). Credit above a bound is
/// discarded, so that a long activity cannot hide a later one. Input that is not finite gives no force and no credit.
///
/// World or device frame, SI. One thread at a time. Realtime.
/// Source: Hannaford, Ryu 2002 (time domain passivity control); Stramigioli et al. 2005 (exact
/// energy of a held force).
#pragma once

#include <cstdint>

#include "spm/model.hpp"

namespace tactus::haptics {

using spm::Vec3d;

struct PassivitySettings {
  double allowance = 5e-7;   ///< J by which E may be negative; without it no motion could start
  double acceleration = 50;  ///< m/s^2, maximum of a hand within a cycle
  double credit = 0.05;      ///< J, maximum, beyond the energy stored by a spring at the port
  double min_speed = 1e-3;   ///< m/s, minimum speed for damping
  double device_mass = 0.1;  ///< kg, minimum: bounds the damping at half of 2 m / T
};

class PassivityController {
 public:
  explicit PassivityController(const PassivitySettings& settings = {}) noexcept : settings_{settings} {}

  /// Clears all state; the next pose is the first.
  void reset() noexcept { *this = PassivityController{settings_}; }

  /// One cycle: the device's pose, the work `passed_on` since the previous cycle, and the wanted force on the hand.
  /// Returns the force to hold until the next cycle. With `control` false it only counts. `stored`: J that the spring
  /// behind the force returns when hand and body separate; this part of the credit is not discarded.
  [[nodiscard]] Vec3d step(const Vec3d& force, const Vec3d& position, double passed_on, double dt, bool control = true,
                           double stored = 0) noexcept;
  /// The force that the hand actually received, if limits changed it after `step`.
  void limited(const Vec3d& force) noexcept { force_ = force; }

  struct Ledger {
    double energy = 0;              ///< J, E
    double lowest = 0;              ///< J, of E
    double withheld = 0;            ///< J that the wanted force would have drawn
    double forgotten = 0;           ///< J of credit discarded above the bound
    std::uint64_t withholding = 0;  ///< cycles
    std::uint64_t damping = 0;      ///< cycles
    std::uint64_t refused = 0;      ///< cycles whose input was not finite
  };
  [[nodiscard]] const Ledger& ledger() const noexcept { return ledger_; }

 private:
  PassivitySettings settings_;
  Ledger ledger_;
  Vec3d position_ = Vec3d::Zero(), force_ = Vec3d::Zero();
  bool started_ = false;
};

}  // namespace tactus::haptics
