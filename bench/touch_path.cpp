#include "bench/touch_path.hpp"

#include <cmath>
#include <numbers>

#include "bench/surface_path.hpp"
#include "spm/fcl/fixed_mesh.hpp"

namespace tactus::bench {
namespace {

constexpr double kApproach = 1, kFollowing = 2, kTapping = 2;  // s
constexpr double kApproachHeight = 0.02;                       // of the approach, above the surface, m
constexpr double kTapHeight = 0.003;                           // m
constexpr double kMinTapRate = 2, kMaxTapRate = 12;            // Hz

/// Returns the height of the tip above the surface path `t` seconds after the approach, m.
double height(double t) {
  const double round = kFollowing + kTapping;
  const double since_following = std::fmod(t, round) - kFollowing;
  if (since_following <= 0) return 0;
  // Number of taps so far. The rate of taps grows linearly, and their number at the end is whole.
  const double taps =
      kMinTapRate * since_following + (kMaxTapRate - kMinTapRate) * since_following * since_following / (2 * kTapping);
  return kTapHeight * (1 - std::cos(2 * std::numbers::pi * taps)) / 2;
}

}  // namespace

std::vector<spm::Vec3d> touch_path(const LoadedModel& subject, const TouchPathSettings& settings) {
  const double unit = subject.model.summary.metres_per_unit;
  const spm::fcl::FixedMesh finest{subject.model.positions, subject.finest};
  const auto approach = static_cast<std::uint32_t>(kApproach / settings.period);
  const std::vector<SurfacePose> along =
      surface_poses(subject.model.positions, subject.finest,
                    {settings.radius / unit, settings.depth / unit, settings.speed * settings.period / unit,
                     settings.poses > approach ? settings.poses - approach : 1, settings.seed},
                    [&](const spm::Vec3d& p) { return finest.distance(p); });
  std::vector<spm::Vec3d> path;
  path.reserve(settings.poses);
  for (std::uint32_t i = 0; i < approach; ++i) {
    const double remaining = 1 - static_cast<double>(i) / approach;
    path.push_back(along[0].centre * unit + along[0].normal * (kApproachHeight * remaining));
  }
  for (std::size_t i = 0; path.size() < settings.poses; ++i)
    path.push_back(along[i].centre * unit + along[i].normal * height(static_cast<double>(i) * settings.period));
  return path;
}

}  // namespace tactus::bench
