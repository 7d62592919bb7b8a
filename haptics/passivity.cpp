#include "haptics/passivity.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::haptics {

Vec3d PassivityController::step(const Vec3d& force, const Vec3d& position, double passed_on, double dt, bool control,
                                double stored) noexcept {
  if (!force.allFinite() || !position.allFinite() || !std::isfinite(passed_on + stored) || !(dt > 0)) {
    ++ledger_.invalid_inputs;
    force_.setZero();
    return force_;
  }
  const Vec3d displacement = started_ ? Vec3d(position - position_) : Vec3d(Vec3d::Zero());
  ledger_.energy = energy_at(position, passed_on);
  started_ = true;
  position_ = position;
  ledger_.lowest = std::min(ledger_.lowest, ledger_.energy);
  if (const double above = ledger_.energy - settings_.credit - stored; above > 0) {
    ledger_.discarded += above;
    ledger_.energy -= above;
  }
  force_ = force;
  if (!control) return force_;

  // Assumes that the next displacement equals this one, plus the displacement by the maximum acceleration.
  const double margin = settings_.acceleration * dt * dt;
  const double available = std::max(0.0, ledger_.energy + settings_.allowance);
  const double length = displacement.norm();
  const auto given = [&](const Vec3d& f) { return f.dot(displacement) + f.norm() * margin; };
  if (const double wanted = given(force_); wanted > available) {
    ++ledger_.withholding;
    if (const double along = length > 0 ? force_.dot(displacement) / length : 0.0; along > 0) {
      // First reduces the part along the motion, because its direction is the most certain.
      const double less = std::min(along, (wanted - available) / length);
      force_ -= less / length * displacement;
    }
    if (const double still = given(force_); still > available) force_ *= std::max(0.0, available / still);
    ledger_.withheld += wanted - given(force_);
  }
  if (ledger_.energy < -settings_.allowance && length > settings_.min_speed * dt) {
    ++ledger_.damping;
    // In one cycle, a damper b takes the energy b v^2 dt = b length^2 / dt.
    const double enough = -ledger_.energy * dt / (length * length);
    force_ -= std::min(enough, settings_.device_mass / dt) / dt * displacement;
  }
  return force_;
}

}  // namespace tactus::haptics
