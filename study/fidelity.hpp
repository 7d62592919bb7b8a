/// Compares the force on a hand with its ground truth: the figures of a study.
///
/// docs/how-to/studies.md defines each figure. Pure; one thread.
#pragma once

#include <string>
#include <vector>

#include "haptics/force.hpp"

namespace tactus::study {

using spm::Vec3d;

/// One number of one run.
struct Figure {
  std::string name, unit;
  double value = 0;  ///< NaN: not available in this run
};
using Figures = std::vector<Figure>;

/// N, smallest perceptible force: the floor of a just noticeable difference.
inline constexpr double kMinForce = 0.05;
/// Just noticeable difference at a force, N.
[[nodiscard]] double jnd_of(double force) noexcept;
/// The same at the end of a stylus of 25 mm, N m.
inline constexpr double kMinTorque = 0.025 * kMinForce;
/// Just noticeable difference at a torque, N m.
[[nodiscard]] double torque_jnd_of(double torque) noexcept;

class Fidelity {
 public:
  /// Adds a millisecond of one hand; `exact`: the contact is on the finest mesh.
  void add(const Vec3d& position, const haptics::Wrench& felt, const haptics::Wrench& truth, bool exact);
  /// The next samples belong to another hand.
  void let_go() noexcept { ms_ += kApart; }
  [[nodiscard]] Figures figures() const;
  /// Additional figures of a tool; torques count while forces do.
  [[nodiscard]] Figures torque_figures() const;

 private:
  struct Touch {
    std::size_t began = 0, ended = 0;  // ms
    Vec3d position = Vec3d::Zero();    // of the hand
    double peak = 0;                   // N
  };
  static constexpr std::size_t kApart = 1000;  // ms between hands, so that their contacts stay separate
  /// Contacts in one of the two forces.
  struct Touches {
    std::vector<Touch> all;
    void add(std::size_t ms, const Vec3d& position, double force);
    /// The first contact that overlaps in time; null when there is none.
    [[nodiscard]] const Touch* overlapping(const Touch& other) const;
  };

  std::size_t ms_ = 0, contact_ = 0, felt_ms_ = 0, exact_ = 0, above_ = 0;
  double squares_ = 0, max_ = 0;
  std::size_t torque_above_ = 0;
  double torque_squares_ = 0, torque_max_ = 0, true_torque_squares_ = 0;
  Touches felt_, truth_;
};

}  // namespace tactus::study
