/// Energy at a hand's port, counted and held above zero.
///
/// A force that is held for a cycle does exactly force * way on the hand, so at each pose the port's energy is known,
/// not estimated:
///
///     E_n = E_(n-1) - F_(n-1) . (x_n - x_(n-1)) - W_n        what the port took from the hand, less what it passed on
///
/// with W_n the work on whatever else it moves (a body that is pushed; zero for a fixed surface). Energy that another
/// user puts into a body may come back out of it: it comes with W_n < 0. The controller looks one cycle ahead and
/// withholds of the force what the hand's motion, or one that it may begin within the cycle, would draw beyond E. So it
/// acts at the end of a release, where a sampled spring gives back more than it took. What is short nevertheless is
/// paid back by damping.
///
/// Guards: no damping below a least speed, none beyond what the device can take (2 m / T); credit above a bound is
/// forgotten, so that a long activity cannot hide a later one; what is not finite gives no force and no credit.
///
/// World or device frame alike, SI. One thread at a time. Realtime.
/// Source: Hannaford, Ryu 2002 (passivity observer and controller in the time domain); Stramigioli et al. 2005 (exact
/// energy of a held force).
#pragma once

#include <cstdint>

#include "spm/model.hpp"

namespace tactus::haptics {

using spm::Vec3d;

struct PassivitySettings {
  double allowance = 5e-7;   ///< J by which E may be negative: without it nothing could begin
  double acceleration = 50;  ///< m/s^2, that a hand may have within a cycle
  double credit = 0.05;      ///< J at most, beyond what a spring at the port stores
  double min_speed = 1e-3;   ///< m/s below which nothing is damped
  double device_mass = 0.1;  ///< kg at the least: bounds the damping at half of 2 m / T
};

class PassivityController {
 public:
  explicit PassivityController(const PassivitySettings& settings = {}) noexcept : settings_{settings} {}

  /// Forgets everything; the next pose is the first.
  void reset() noexcept { *this = PassivityController{settings_}; }

  /// One cycle: the device's pose, the work `passed_on` since the last one, and the force wanted on the hand. Gives the
  /// force to hold until the next. False for `control`: counts only. `stored`: J that the spring behind the force gives
  /// back when hand and body part, which is not forgotten.
  [[nodiscard]] Vec3d step(const Vec3d& force, const Vec3d& position, double passed_on, double dt, bool control = true,
                           double stored = 0) noexcept;
  /// What the hand was given after all, when limits came after `step`.
  void limited(const Vec3d& force) noexcept { force_ = force; }

  struct Ledger {
    double energy = 0;              ///< J, E
    double lowest = 0;              ///< J, of E
    double withheld = 0;            ///< J that the wanted force would have drawn and did not
    double forgotten = 0;           ///< J of credit above the bound
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
