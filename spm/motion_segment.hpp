/// Predicts the path of a hand along a surface from its earlier turns.
///
/// The heading of a hand in the tangent plane changes smoothly; the surface determines the motion across that plane. A
/// linear rule predicts the next turns from the last ones. It is fitted while the hand moves, by least squares with
/// exponential forgetting. The predicted path follows the labelled cells. The distances between earlier predictions and
/// the real path give the uncertainty. Model frame, file units, seconds. Fixed memory. One thread, not the haptic one.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "spm/region_grid.hpp"

namespace tactus::spm {

class MotionSegment {
 public:
  static constexpr double kStep = 0.01;  ///< s between the points of a path
  static constexpr int kSteps = 15;      ///< of a path

  struct Way {
    std::array<Vec3d, kSteps + 1> points;  ///< starts at the tip
    std::uint32_t count = 0;               ///< points; 0: no prediction
  };

  /// Adds the position of the tip's centre, every kSpacing seconds. `reach`: see `ahead`. Every fifth call fits the
  /// rule and costs some 50 us; one in 55 also predicts a path.
  static constexpr double kSpacing = 0.002;
  void observe(const RegionGrid& grid, double reach, const Vec3d& position);
  /// Forgets the positions, but not the rule.
  void interrupt() noexcept;

  /// Predicts the path for `lead` seconds, rounded up to steps, at most kSteps; empty in the first 0.14 s. `reach`:
  /// radius of the surface around the tip from which the tangent plane is computed. About 20 us and 20 us for each
  /// step.
  [[nodiscard]] Way ahead(const RegionGrid& grid, double reach, double lead) const;
  /// Root mean square of the distance between predicted and real path after `time`.
  [[nodiscard]] double doubt(double time) const noexcept;

 private:
  static constexpr std::uint32_t kPerStep = 5;  // samples
  static constexpr int kTurns = 12;             // that the rule uses
  static constexpr std::uint32_t kPast = kPerStep * (kSteps + kTurns + 2);
  using Turns = Eigen::Matrix<double, kTurns, 1>;
  struct Sample {
    Vec3d position, normal;
  };

  [[nodiscard]] const Sample& sample(std::uint32_t back) const noexcept {
    return past_[(newest_ + kPast - back) % kPast];
  }
  [[nodiscard]] Vec3d heading(std::uint32_t back) const noexcept;
  [[nodiscard]] Turns turns(std::uint32_t back) const noexcept;
  void learn(double slowest);
  void compare();

  std::array<Sample, kPast> past_;
  std::uint32_t newest_ = 0, count_ = 0, since_step_ = 0;
  Vec3d plane_at_ = Vec3d::Zero();  // the position of the newest normal
  Eigen::Matrix<double, kTurns, kTurns> squares_ = Eigen::Matrix<double, kTurns, kTurns>::Zero();
  Eigen::Matrix<double, kTurns, kSteps> products_ = Eigen::Matrix<double, kTurns, kSteps>::Zero();
  Eigen::Matrix<double, kTurns, kSteps> rule_ = Eigen::Matrix<double, kTurns, kSteps>::Zero();
  static constexpr int kJudged = 11;  // the step at which a predicted path is compared with the real one
  Way expected_;                      // the prediction that is being compared
  int waited_ = 0;
  double missed_ = -1;  // mean square error after kJudged steps; below 0: not known yet
};

}  // namespace tactus::spm
