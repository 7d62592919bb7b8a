/// A jump that is let through little by little: what is left of it is taken off, and becomes less at a steady rate.
///
///     in   _____|~~~~~~~~~~~     out  _____/~~~~~~~~     left = in - out
///
/// Any unit. One thread at a time. Realtime.
#pragma once

#include "spm/model.hpp"

namespace tactus::haptics {

class Ramp {
 public:
  void set(const spm::Vec3d& left) noexcept { left_ = left; }
  /// One step: less is left, by `most` at most.
  void advance(double max) noexcept {
    const double length = left_.norm();
    if (length > max)
      left_ *= 1 - max / length;
    else
      left_.setZero();
  }
  [[nodiscard]] const spm::Vec3d& left() const noexcept { return left_; }
  [[nodiscard]] bool over() const noexcept { return left_.isZero(0); }

 private:
  spm::Vec3d left_ = spm::Vec3d::Zero();
};

}  // namespace tactus::haptics
