/// Turns a jump of a vector into a change at a constant rate. The caller subtracts `remaining()` from the vector. Each
/// step shortens `remaining()`.
///
///     in   _____|~~~~~~~~~~~     out  _____/~~~~~~~~     remaining = in - out
///
/// Any unit. One thread at a time. Realtime.
#pragma once

#include "spm/model.hpp"

namespace tactus::haptics {

class Ramp {
 public:
  /// Begins a ramp. `remaining`: the jump, or the part of it that the output has not made yet.
  void set(const spm::Vec3d& remaining) noexcept { remaining_ = remaining; }
  /// Makes one step: shortens the remaining part by at most `max`.
  void advance(double max) noexcept {
    const double length = remaining_.norm();
    if (length > max)
      remaining_ *= 1 - max / length;
    else
      remaining_.setZero();
  }
  [[nodiscard]] const spm::Vec3d& remaining() const noexcept { return remaining_; }
  [[nodiscard]] bool done() const noexcept { return remaining_.isZero(0); }

 private:
  spm::Vec3d remaining_ = spm::Vec3d::Zero();
};

}  // namespace tactus::haptics
