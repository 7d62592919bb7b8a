/// Compares the force on a hand with its ground truth and computes the figures of a study.
///
/// docs/how-to/studies.md defines each figure. One thread.
#pragma once

#include <string>
#include <vector>

#include "haptics/force.hpp"

namespace tactus::study {

using spm::Vec3d;

/// A named number of a run.
struct Figure {
  std::string name, unit;
  double value = 0;  ///< NaN: not available in this run
};
using Figures = std::vector<Figure>;

/// Smallest perceptible force, and so the smallest just noticeable difference of forces, N.
inline constexpr double kMinForce = 0.05;
/// Just noticeable difference of a force, N.
[[nodiscard]] double jnd_of(double force) noexcept;
/// Torque of kMinForce at a lever of 25 mm, N m.
inline constexpr double kMinTorque = 0.025 * kMinForce;
/// Just noticeable difference of a torque, N m.
[[nodiscard]] double torque_jnd_of(double torque) noexcept;

class Fidelity {
 public:
  /// Adds one millisecond of a hand. `felt`: wrench of the session. `truth`: wrench of the ground truth. `exact`: the
  /// session reported an exact contact.
  void add(const Vec3d& position, const haptics::Wrench& felt, const haptics::Wrench& truth, bool exact);
  /// Call between the samples of two hands.
  void start_next_hand() noexcept { ms_ += kHandGapMs; }
  [[nodiscard]] Figures figures() const;
  /// Returns the figures of the torques of a tool, over the same milliseconds as `figures`.
  [[nodiscard]] Figures torque_figures() const;

 private:
  struct Touch {
    std::size_t begin = 0, end = 0;  // ms
    Vec3d position = Vec3d::Zero();  // of the hand at `begin`
    double peak = 0;                 // N
  };
  static constexpr std::size_t kHandGapMs = 1000;  // separates the touches of two hands
  /// The touches of the felt force, or those of the true force.
  struct Touches {
    std::vector<Touch> all;
    void add(std::size_t ms, const Vec3d& position, double force);
    /// Returns the first touch that overlaps `other` in time; null when there is none.
    [[nodiscard]] const Touch* overlapping(const Touch& other) const;
  };

  std::size_t ms_ = 0, contact_ms_ = 0, felt_ms_ = 0, exact_ms_ = 0, above_jnd_ms_ = 0;
  double squares_ = 0, max_ = 0;  // of force errors
  std::size_t torque_above_jnd_ms_ = 0;
  double torque_squares_ = 0, torque_max_ = 0, true_torque_squares_ = 0;
  Touches felt_, truth_;
};

}  // namespace tactus::study
