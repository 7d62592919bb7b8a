/// How a hand goes on along a surface, learned from how it has turned before.
///
/// A hand's heading in the plane of the surface changes smoothly; what it does across that plane the surface says. So
/// the turns of the last moments foretell those of the next ones, by a linear rule that is fitted while the hand moves
/// (least squares, old moments fade), and the way that follows is laid over the labelled cells. How far reality was
/// from such ways tells how wide to look. Model frame, file units, seconds. Fixed memory. One thread; not the haptic
/// one.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "spm/region_grid.hpp"

namespace tactus::spm {

class MotionSegment {
 public:
  static constexpr double kStep = 0.01;  ///< s between the points of a way
  static constexpr int kSteps = 15;      ///< of a way

  struct Way {
    std::array<Vec3d, kSteps + 1> points;  ///< from where the tip is on
    std::uint32_t count = 0;               ///< of them; 0: nothing is known
  };

  /// The tip's centre, every kSpacing seconds. `reach` as for `ahead`. Each fifth costs some 50 us and solves the rule,
  /// one in 55 a way besides.
  static constexpr double kSpacing = 0.002;
  void observe(const RegionGrid& grid, double reach, const Vec3d& position);
  /// Nothing from before counts for what is to come, but for how the hand turns.
  void interrupt() noexcept;

  /// Where the tip will be for `lead` seconds, rounded up to steps, at most kSteps; empty in the first 0.14 s. `reach`
  /// is of the surface around it that counts as its plane. About 20 us, and 20 more for each step.
  [[nodiscard]] Way ahead(const RegionGrid& grid, double reach, double lead) const;
  /// Root mean square of how far the tip was, after `time`, from the way that had been expected.
  [[nodiscard]] double doubt(double time) const noexcept;

 private:
  static constexpr std::uint32_t kPerStep = 5;  // samples
  static constexpr int kTurns = 12;             // that a rule looks back to
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
  Vec3d plane_at_ = Vec3d::Zero();  // where the newest normal is of
  Eigen::Matrix<double, kTurns, kTurns> squares_ = Eigen::Matrix<double, kTurns, kTurns>::Zero();
  Eigen::Matrix<double, kTurns, kSteps> products_ = Eigen::Matrix<double, kTurns, kSteps>::Zero();
  Eigen::Matrix<double, kTurns, kSteps> rule_ = Eigen::Matrix<double, kTurns, kSteps>::Zero();
  static constexpr int kJudged = 11;  // the step after which a way is compared with what came
  Way expected_;                      // one after the other
  int waited_ = 0;
  double missed_ = -1;  // mean square, after kJudged steps; below 0: not known, it starts with the reach
};

}  // namespace tactus::spm
