#include "bench/touch_path.hpp"

#include <cmath>

#include "bench/surface_path.hpp"
#include "spm/fcl/fixed_mesh.hpp"

namespace tactus::bench {
namespace {

constexpr double kApproach = 1, kFollowing = 2, kTapping = 2;  // s
constexpr double kFrom = 0.02;                                 // m above the surface at which the approach begins
constexpr double kTapHeight = 0.003;                           // m
constexpr double kSlowest = 2, kFastest = 12;                  // Hz, of taps

/// m above the path on the surface, t seconds after the approach.
double height(double t) {
  constexpr double kTurns = 2 * 3.14159265358979323846;
  const double round = kFollowing + kTapping;
  const double at = std::fmod(t, round) - kFollowing;
  if (at <= 0) return 0;
  // The phase of taps that become faster evenly; it ends on a whole number of them.
  const double phase = kSlowest * at + (kFastest - kSlowest) * at * at / (2 * kTapping);
  return kTapHeight * (1 - std::cos(kTurns * phase)) / 2;
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
    const double left = 1 - static_cast<double>(i) / approach;
    path.push_back(along[0].centre * unit + along[0].normal * (kFrom * left));
  }
  for (std::size_t i = 0; path.size() < settings.poses; ++i)
    path.push_back(along[i].centre * unit + along[i].normal * height(static_cast<double>(i) * settings.period));
  return path;
}

}  // namespace tactus::bench
