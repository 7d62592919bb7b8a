/// What a hand felt beside what it would have felt where everything is at hand: the figures of a study.
///
/// docs/how-to/studies.md has what each figure means. Pure; one thread.
#pragma once

#include <string>
#include <vector>

#include "haptics/force.hpp"

namespace tactus::study {

using spm::Vec3d;

/// One number of one run.
struct Figure {
  std::string name, unit;
  double value = 0;  ///< NaN: this run has none
};
using Figures = std::vector<Figure>;

/// Less is not felt, N: the floor of a just noticeable difference.
inline constexpr double kMinForce = 0.05;
/// Just noticeable difference from a force, N.
[[nodiscard]] double jnd_of(double force) noexcept;
/// The same at the end of a stylus of 25 mm, N m.
inline constexpr double kMinTorque = 0.025 * kMinForce;
/// From a torque, N m.
[[nodiscard]] double torque_jnd_of(double torque) noexcept;

class Fidelity {
 public:
  /// A millisecond of one hand; `exact`: the contact is on the finest mesh.
  void add(const Vec3d& place, const haptics::Wrench& felt, const haptics::Wrench& truth, bool exact);
  /// What comes next is another hand's.
  void let_go() noexcept { ms_ += kApart; }
  [[nodiscard]] Figures figures() const;
  /// What a tool adds to them; torques count while forces do.
  [[nodiscard]] Figures torque_figures() const;

 private:
  struct Touch {
    std::size_t began = 0, ended = 0;  // ms
    Vec3d place = Vec3d::Zero();       // where the hand was
    double peak = 0;                   // N
  };
  static constexpr std::size_t kApart = 1000;  // ms between hands
  /// Touches of one of the two forces.
  struct Touches {
    std::vector<Touch> all;
    void add(std::size_t ms, const Vec3d& place, double force);
    /// The first that does; null when none does.
    [[nodiscard]] const Touch* overlapping(const Touch& other) const;
  };

  std::size_t ms_ = 0, contact_ = 0, felt_ms_ = 0, exact_ = 0, above_ = 0;
  double squares_ = 0, max_ = 0;
  std::size_t torque_above_ = 0;
  double torque_squares_ = 0, torque_max_ = 0, true_torque_squares_ = 0;
  Touches felt_, truth_;
};

}  // namespace tactus::study
