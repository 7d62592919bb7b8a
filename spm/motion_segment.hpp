/// Predicts the path of a hand along a surface from the earlier turns of the hand: the changes of its heading.
///
/// The heading of a hand in the tangent plane changes smoothly, so a linear rule predicts the next headings from the
/// last turns. The rule is fitted while the hand moves, by least squares with exponential forgetting. The surface
/// determines the motion along the normal of the tangent plane, so the predicted path follows the labelled cells. The
/// uncertainty is computed from the distances between earlier predictions and the real path.
///
/// Model frame, file units, seconds. Fixed memory. One thread, not the haptic one.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "spm/region_grid.hpp"

namespace tactus::spm {

class MotionSegment {
 public:
  static constexpr double kStep = 0.01;  ///< time between the points of a path, s
  static constexpr int kSteps = 15;      ///< max number of steps of a path

  struct Path {
    std::array<Vec3d, kSteps + 1> points;  ///< the first one is the position of the tip
    std::uint32_t count = 0;               ///< number of points; 0 if there is no prediction
  };

  static constexpr double kSpacing = 0.002;  ///< time between calls of `observe`, s
  /// Adds the position of the tip's centre. `reach` is that of `predict`. Every fifth call fits the rule and costs some
  /// 50 us; one call in 55 also predicts a path.
  void observe(const RegionGrid& grid, double reach, const Vec3d& position);
  /// Drops the positions. The rule is not changed.
  void restart() noexcept;

  /// Predicts the path for `lead` seconds, rounded up to steps of kStep, at most kSteps. The path is empty in the first
  /// 0.14 s after construction or `restart`. The tangent plane is computed from the labelled cells within `reach` of
  /// the tip. Takes about 20 us and another 20 us for each step.
  [[nodiscard]] Path predict(const RegionGrid& grid, double reach, double lead) const;
  /// Estimates the root mean square of the distance between predicted and real path after `time` seconds.
  [[nodiscard]] double rms_error(double time) const noexcept;

 private:
  static constexpr std::uint32_t kPerStep = 5;  // samples in a step
  static constexpr int kTurns = 12;             // number of turns from which the rule predicts
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
  void fit_rule(double slowest);
  void update_error();

  std::array<Sample, kPast> past_;
  std::uint32_t newest_ = 0, count_ = 0, since_step_ = 0;
  Vec3d plane_at_ = Vec3d::Zero();  // position at which the newest normal was computed
  Eigen::Matrix<double, kTurns, kTurns> squares_ = Eigen::Matrix<double, kTurns, kTurns>::Zero();
  Eigen::Matrix<double, kTurns, kSteps> products_ = Eigen::Matrix<double, kTurns, kSteps>::Zero();
  Eigen::Matrix<double, kTurns, kSteps> rule_ = Eigen::Matrix<double, kTurns, kSteps>::Zero();
  static constexpr int kJudged = 11;  // number of steps after which a predicted path is compared with the real one
  Path expected_;                     // the predicted path that will be compared
  int waited_ = 0;                    // steps since this prediction
  double mean_square_error_ = -1;     // after kJudged steps; negative if not known yet
};

}  // namespace tactus::spm
