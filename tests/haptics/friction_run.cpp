#include "tests/haptics/friction_run.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>

#include "haptics/proxy.hpp"

namespace tactus::haptics::testing {

bool AnalyticSphere::sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept {
  const double reach = hollow_ ? radius_ - radius : radius_ + radius;
  const Vec3d motion = to - from;
  const double sign = hollow_ ? -1 : 1;
  double time = 0;
  if (sign * (from.norm() - reach) > 0) {
    // |from + t motion| = reach
    const double a = motion.squaredNorm(), b = from.dot(motion), c = from.squaredNorm() - reach * reach;
    const double root = b * b - a * c;
    if (!(root >= 0) || a == 0) return false;
    time = hollow_ ? (-b + std::sqrt(root)) / a : c / (-b + std::sqrt(root));
    if (!(time >= 0 && time <= 1)) return false;
  }
  const Vec3d at = from + time * motion;
  if (!(normal(at).dot(motion) < 0)) return false;
  hit = {};
  hit.time = time;
  hit.normal = normal(at);
  hit.point = at - hit.normal * radius;
  hit.object = hit.face = 0;
  return true;
}

bool AnalyticSphere::closest(const Vec3d& point, double within, SurfaceHit& hit) const noexcept {
  const double distance = (hollow_ ? -1 : 1) * (point.norm() - radius_);
  if (std::abs(distance) > within) return false;
  hit = {};
  hit.distance = distance;
  hit.normal = normal(point);
  hit.point = point.normalized() * radius_;
  hit.object = hit.face = 0;
  return true;
}

FrictionResult run_friction(AnalyticSphere sphere, double static_friction, double dynamic_friction, double max_speed,
                            std::uint64_t cycles, std::uint64_t seed) {
  constexpr double kCycle = 1e-3, kTip = 0.003;
  constexpr double kMin = 0.0002, kMax = 0.002;         // m, of depth
  constexpr std::uint64_t kSegment = 400, kRest = 100;  // cycles
  std::mt19937_64 random{seed};
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  Proxy proxy;
  proxy.set_grip({static_friction, dynamic_friction});
  FrictionResult result;

  // The point on the surface moves along great circles that rotate slowly; the hand is below it.
  Vec3d up = Vec3d::UnitZ(), ahead = Vec3d::UnitX();
  const double side = sphere.hollow() ? -1 : 1;
  const double resting = sphere.radius() + side * kTip;  // of the centre of a tip that only touches
  double speed = 0, depth = kMin;
  (void)proxy.step(up * (resting + side * kTip), kCycle, sphere, false);
  bool slipped = false;
  for (std::uint64_t i = 0; i < cycles; ++i) {
    if (i % kSegment == 0) speed = max_speed * uniform(random);
    const double along = i % kSegment < kSegment - kRest ? speed * kCycle : 0;
    ahead = (ahead + 0.02 * normal(random) * up.cross(ahead)).normalized();
    up = Eigen::AngleAxisd{along / sphere.radius(), up.cross(ahead).normalized()} * up;
    ahead = (ahead - up * up.dot(ahead)).normalized();
    depth = std::clamp(depth + 2e-5 * normal(random), kMin, kMax);
    const Vec3d device = up * (resting - side * depth);

    const Vec3d before = proxy.last().proxy;
    const ProxyResult& now = proxy.step(device, kCycle, sphere, false);
    if (!now.in_contact) continue;
    const Vec3d force = now.proxy - device, upright = sphere.normal(now.proxy);
    const double pressing = force.dot(upright);
    const double ratio = (force - pressing * upright).norm() / pressing;
    if (now.sticking) {
      ++result.sticking;
      result.max_stuck = std::max(result.max_stuck, ratio / static_friction);
      result.stick_error = std::max(result.stick_error, ratio / static_friction - 1);
      if (slipped) {
        ++result.stuck_again;
        result.max_return = std::max(result.max_return, ratio / static_friction);
      }
    } else {
      ++result.slipping;
      // Within the dynamic cone it rests, although it would slip with the next motion.
      const Vec3d moved = now.proxy - before;
      constexpr double kMoves = 1e-6;  // m
      if ((moved - upright * upright.dot(moved)).norm() > std::max(kMoves, along / 2))
        result.slip_error = std::max(result.slip_error, std::abs(ratio / dynamic_friction - 1));
    }
    slipped = !now.sticking;
  }
  return result;
}

}  // namespace tactus::haptics::testing
