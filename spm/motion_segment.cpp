#include "spm/motion_segment.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace tactus::spm {
namespace {

Vec3d tangential(const Vec3d& v, const Vec3d& normal) { return v - normal * normal.dot(v); }

double angle(const Vec3d& from, const Vec3d& to, const Vec3d& normal) {
  return std::atan2(normal.dot(from.cross(to)), from.dot(to));
}

/// Calls `visit(centre, weight)` for the labelled cells near `p`. `centre` is relative to `p`. The weight decreases to
/// 0 at the distance `reach`.
template <class Visit>
void for_each_cell(const RegionGrid& grid, const Vec3d& p, double reach, Visit&& visit) {
  grid.for_each_intersecting(p, reach, [&](RegionId, double, const CellBox& box) {
    const Vec3d from = (box.low + box.high) / 2 - p;
    const double near = 1 - from.squaredNorm() / (reach * reach);
    if (near > 0) visit(from, near * near);
  });
}

/// Returns the normal of the plane through the labelled cells around `p`, on the side of `before`. Returns `before` if
/// there are too few cells.
Vec3d plane_normal(const RegionGrid& grid, const Vec3d& p, double reach, const Vec3d& before) {
  double weights = 0;
  Vec3d mean = Vec3d::Zero();
  Eigen::Matrix3d square = Eigen::Matrix3d::Zero();
  for_each_cell(grid, p, reach, [&](const Vec3d& from, double weight) {
    weights += weight;
    mean += weight * from;
    square += weight * from * from.transpose();
  });
  if (weights < 1) return before;
  mean /= weights;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(square / weights - mean * mean.transpose());
  const Vec3d normal = solver.eigenvectors().col(0);
  return normal.dot(before) < 0 ? Vec3d{-normal} : normal;
}

/// Computes the mean height of the labelled cells around `p` along `normal`. False if there are none.
bool height(const RegionGrid& grid, const Vec3d& p, double reach, const Vec3d& normal, double& above) {
  double weights = 0, sum = 0;
  for_each_cell(grid, p, reach, [&](const Vec3d& from, double weight) {
    weights += weight;
    sum += weight * normal.dot(from);
  });
  if (weights <= 0) return false;
  above = sum / weights;
  return true;
}

double squared_distance(const Vec3d& p, const Vec3d& a, const Vec3d& b) {
  const Vec3d edge = b - a;
  const double length = edge.squaredNorm();
  const double at = length > 0 ? std::clamp((p - a).dot(edge) / length, 0.0, 1.0) : 0.0;
  return (a + at * edge - p).squaredNorm();
}

}  // namespace

Vec3d MotionSegment::heading(std::uint32_t back) const noexcept {
  return tangential(sample(back).position - sample(back + kPerStep).position, sample(back).normal);
}

MotionSegment::Turns MotionSegment::turns(std::uint32_t back) const noexcept {
  const Vec3d now = heading(back);
  Turns turns;
  for (int k = 0; k < kTurns; ++k)
    turns[k] = angle(heading(back + kPerStep * static_cast<std::uint32_t>(k + 1)), now, sample(back).normal) / (k + 1);
  return turns;
}

void MotionSegment::observe(const RegionGrid& grid, double reach, const Vec3d& position) {
  constexpr double kSlowest = 1e-3;  // slower motion counts as rest; `reach` per step
  const bool is_step = ++since_step_ >= kPerStep || count_ == 0;
  const Vec3d before = count_ > 0 ? sample(0).normal : Vec3d::UnitZ();
  newest_ = (newest_ + 1) % kPast;
  const bool is_at_rest = count_ > 0 && (position - plane_at_).norm() <= kSlowest * reach;
  past_[newest_] = {position, is_step && !is_at_rest ? plane_normal(grid, position, reach, before) : before};
  if (is_step && !is_at_rest) plane_at_ = position;
  count_ = std::min(count_ + 1, kPast);
  if (!is_step) return;
  since_step_ = 0;
  if (mean_square_error_ < 0) mean_square_error_ = reach * reach;
  update_error();
  fit_rule(kSlowest * reach);
  if (expected_.count == 0) {
    expected_ = predict(grid, reach, kJudged * kStep);
    waited_ = 0;
  }
}

void MotionSegment::restart() noexcept {
  count_ = 0;
  expected_.count = 0;
}

void MotionSegment::fit_rule(double slowest) {
  constexpr double kForgetting = 1 - 1.0 / 3000;  // factor of earlier samples, for each step
  constexpr double kStiffness = 1e-3;  // regularization towards a straight path, relative to the mean square of turns
  constexpr std::uint32_t kThen = kPerStep * kSteps;  // the rule predicts from this sample to the newest one
  if (count_ < kPast) return;
  const Turns past_turns = turns(kThen);
  const Vec3d heading_then = heading(kThen);
  if (heading_then.norm() < slowest) return;  // the heading of a tip at rest is noise
  squares_ = squares_ * kForgetting + past_turns * past_turns.transpose();
  products_ *= kForgetting;
  for (int m = 0; m < kSteps; ++m) {
    const std::uint32_t from = kThen - kPerStep * static_cast<std::uint32_t>(m);
    const Vec3d moved = sample(from - kPerStep).position - sample(from).position;
    products_.col(m) += past_turns * angle(heading_then, tangential(moved, sample(kThen).normal), sample(kThen).normal);
  }
  Eigen::Matrix<double, kTurns, kTurns> regularized = squares_;
  regularized.diagonal().array() += kStiffness * squares_.trace() / kTurns + 1e-12;
  rule_ = regularized.ldlt().solve(products_);
}

void MotionSegment::update_error() {
  constexpr double kShare = 0.1;  // weight of a new error in the mean
  if (expected_.count == 0 || ++waited_ < kJudged) return;
  double nearest = (expected_.points[0] - sample(0).position).squaredNorm();
  for (std::uint32_t i = 1; i < expected_.count; ++i)
    nearest = std::min(nearest, squared_distance(sample(0).position, expected_.points[i - 1], expected_.points[i]));
  mean_square_error_ += kShare * (nearest - mean_square_error_);
  expected_.count = 0;
}

MotionSegment::Path MotionSegment::predict(const RegionGrid& grid, double reach, double lead) const {
  constexpr int kPlaneEvery = 2;  // steps
  Path path;
  if (count_ < kPerStep * (kTurns + 2)) return path;
  Vec3d normal = sample(0).normal;
  Vec3d forward = heading(0).normalized();
  constexpr std::uint32_t kSpeedSamples = 4 * kPerStep;
  double length = 0;
  for (std::uint32_t back = 0; back < kSpeedSamples; ++back)
    length += (sample(back).position - sample(back + 1).position).norm();
  length *= double{kPerStep} / kSpeedSamples;
  const Eigen::Matrix<double, kSteps, 1> headings = rule_.transpose() * turns(0);
  Vec3d at = sample(0).position;
  double height_at_tip = 0;
  const double near = reach / 2;
  const bool has_cells = height(grid, at, near, normal, height_at_tip);
  path.points[path.count++] = at;
  double slope = 0;
  for (int m = 0; m < kSteps && m * kStep < lead; ++m) {
    const double sideways = length / std::sqrt(1 + slope * slope);
    at += sideways * (std::cos(headings[m]) * forward + std::sin(headings[m]) * normal.cross(forward));
    double above = height_at_tip;
    if (has_cells && height(grid, at, near, normal, above)) at += (above - height_at_tip) * normal;
    slope = sideways > 0 ? (above - height_at_tip) / sideways : 0;
    path.points[path.count++] = at;
    if (m % kPlaneEvery != kPlaneEvery - 1) continue;
    // Rotates the tangent plane with the surface, and the heading into the new plane.
    const Vec3d next = plane_normal(grid, at, reach, normal);
    forward = tangential(forward, next).normalized();
    normal = next;
  }
  return path;
}

double MotionSegment::rms_error(double time) const noexcept {
  const double share = time / (kJudged * kStep);
  return std::sqrt(std::max(0.0, mean_square_error_)) * share * share;
}

}  // namespace tactus::spm
