// Tests that a predicted path continues the earlier turns of the hand and follows the surface.

#include "spm/motion_segment.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <set>
#include <vector>

#include "tests/support/cells.hpp"

namespace tactus::spm {
namespace {

constexpr double kReach = 4;             // cell edges
constexpr double kCellsPerSecond = 100;  // cell edges/s

/// The cells of edge 1 that contain at least one of `points`.
class Cells {
 public:
  explicit Cells(const std::vector<Vec3d>& points) {
    std::set<std::array<std::uint16_t, 3>> cells;
    for (const Vec3d& p : points)
      cells.insert({static_cast<std::uint16_t>(p[0] + kHalf), static_cast<std::uint16_t>(p[1] + kHalf),
                    static_cast<std::uint16_t>(p[2] + kHalf)});
    for (const std::array<std::uint16_t, 3>& cell : cells) {
      Region region{};
      region.cell = cell;
      region.occupied = {~0u, ~0u};
      regions_.push_back(region);
    }
    test_support::sort_cells(regions_);
  }
  [[nodiscard]] RegionGrid grid() const {
    return {GridFrame{{-kHalf, -kHalf, -kHalf}, 1}, std::span<const Region>{regions_}};
  }

 private:
  static constexpr double kHalf = 64;
  std::vector<Region> regions_;
};

std::vector<Vec3d> floor() {
  std::vector<Vec3d> points;
  for (int x = -60; x < 60; ++x)
    for (int y = -60; y < 60; ++y) points.emplace_back(x + 0.5, y + 0.5, 0.5);
  return points;
}

void follow(MotionSegment& motion_segment, const RegionGrid& grid, const std::function<Vec3d(double)>& path,
            double from, double to) {
  for (int i = 0; from + i * MotionSegment::kSpacing <= to; ++i)
    motion_segment.observe(grid, kReach, path(from + i * MotionSegment::kSpacing));
}

/// Returns a point of a path of loops at constant speed. The heading oscillates like the heading of a hand.
Vec3d looping_path(double time) {
  static const std::vector<Vec3d> path = [] {
    std::vector<Vec3d> points{{0, -25, 0.5}};
    for (double t = 0; t < 20; t += MotionSegment::kSpacing) {
      const double heading = 4 * t + std::sin(8 * t);
      points.push_back(points.back() +
                       kCellsPerSecond * MotionSegment::kSpacing * Vec3d{std::cos(heading), std::sin(heading), 0});
    }
    return points;
  }();
  return path[static_cast<std::size_t>(std::lround(time / MotionSegment::kSpacing))];
}

TEST(MotionSegment, LearnsTheTurnsOfAHand) {
  const RegionGrid grid = Cells{floor()}.grid();
  MotionSegment motion_segment;
  follow(motion_segment, grid, looping_path, 0, 12);

  double learned = 0, straight = 0;
  for (double time = 12; time < 14; time += 0.1) {
    follow(motion_segment, grid, looping_path, time + MotionSegment::kSpacing, time + 0.1);
    const double now = time + 0.1;
    const MotionSegment::Path path = motion_segment.predict(grid, kReach, 0.11);
    ASSERT_EQ(path.count, 12u);
    const Vec3d previous = looping_path(now - 0.01), present = looping_path(now), future = looping_path(now + 0.11);
    learned += (path.points[11] - future).norm();
    straight += (present + 11 * (present - previous) - future).norm();
  }

  EXPECT_LT(learned, straight / 4);
}

TEST(MotionSegment, FollowsTheSurface) {
  constexpr double kRadius = 20;
  std::vector<Vec3d> cylinder;
  for (double angle = 0; angle < 6.29; angle += 0.01)
    for (int y = -60; y < 60; ++y) cylinder.emplace_back(kRadius * std::cos(angle), y + 0.5, kRadius * std::sin(angle));
  const RegionGrid grid = Cells{cylinder}.grid();
  const auto circle = [](double time) {
    const double angle = kCellsPerSecond * time / kRadius;
    return Vec3d{kRadius * std::cos(angle), 0, kRadius * std::sin(angle)};
  };
  MotionSegment motion_segment;
  follow(motion_segment, grid, circle, 0, 1);

  const MotionSegment::Path path = motion_segment.predict(grid, kReach, 0.15);

  ASSERT_EQ(path.count, 16u);
  for (std::uint32_t i = 0; i < path.count; ++i) {
    EXPECT_NEAR(std::hypot(path.points[i][0], path.points[i][2]), kRadius, 1) << i;
    EXPECT_LT((path.points[i] - circle(1 + i * MotionSegment::kStep)).norm(), 0.2 * i + 0.1) << i;
  }
}

TEST(MotionSegment, EstimatesALargerErrorAfterWrongPredictions) {
  const RegionGrid grid = Cells{floor()}.grid();
  MotionSegment motion_segment;
  EXPECT_EQ(motion_segment.rms_error(0.11), 0) << "there was no prediction yet";
  const auto straight = [](double time) { return Vec3d{-50 + 10 * time, 0.5, 0.5}; };
  follow(motion_segment, grid, straight, 0, 8);
  const double error_on_line = motion_segment.rms_error(0.11);
  const auto zigzag = [&](double time) {
    const double share = std::fmod(time, 0.3) / 0.15;
    return Vec3d{straight(time)[0], 10 * (share < 1 ? share : 2 - share), 0.5};
  };
  follow(motion_segment, grid, zigzag, 8.002, 9);

  EXPECT_LT(error_on_line, 0.1);
  EXPECT_GT(motion_segment.rms_error(0.11), 1);
  EXPECT_LT(motion_segment.rms_error(0.02), motion_segment.rms_error(0.11) / 4);
}

TEST(MotionSegment, PredictsNoPathRightAfterARestart) {
  const RegionGrid grid = Cells{floor()}.grid();
  MotionSegment motion_segment;
  follow(motion_segment, grid, looping_path, 0, 1);
  motion_segment.restart();
  follow(motion_segment, grid, looping_path, 2, 2.05);

  EXPECT_EQ(motion_segment.predict(grid, kReach, 0.1).count, 0u);
}

TEST(MotionSegment, PredictsThatATipAtRestDoesNotMove) {
  const RegionGrid grid = Cells{floor()}.grid();
  MotionSegment motion_segment;
  const Vec3d position{3, 4, 0.5};
  const auto at_rest = [&](double) { return position; };
  follow(motion_segment, grid, at_rest, 0, 1);

  const MotionSegment::Path path = motion_segment.predict(grid, kReach, 0.1);

  ASSERT_EQ(path.count, 11u);
  for (std::uint32_t i = 0; i < path.count; ++i) EXPECT_LT((path.points[i] - position).norm(), 1e-9);
}

}  // namespace
}  // namespace tactus::spm
