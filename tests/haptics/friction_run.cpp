#include "tests/haptics/friction_run.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <random>

#include "haptics/proxy.hpp"

namespace tactus::haptics::testing {

bool AnalyticSphere::sweep(const Vec3d& from, const Vec3d& to, double radius, SurfaceHit& hit) noexcept {
  const double contact_radius = hollow_ ? radius_ - radius : radius_ + radius;
  const Vec3d motion = to - from;
  const double outwards = hollow_ ? -1 : 1;
  double time = 0;
  if (outwards * (from.norm() - contact_radius) > 0) {
    // |from + t motion| = contact_radius
    const double a = motion.squaredNorm(), b = from.dot(motion),
                 c = from.squaredNorm() - contact_radius * contact_radius;
    const double discriminant = b * b - a * c;
    if (!(discriminant >= 0) || a == 0) return false;
    time = hollow_ ? (-b + std::sqrt(discriminant)) / a : c / (-b + std::sqrt(discriminant));
    if (!(time >= 0 && time <= 1)) return false;
  }
  const Vec3d centre = from + time * motion;
  if (!(normal(centre).dot(motion) < 0)) return false;
  hit = {};
  hit.time = time;
  hit.normal = normal(centre);
  hit.point = centre - hit.normal * radius;
  hit.object = hit.face = 0;
  return true;
}

bool AnalyticSphere::closest(const Vec3d& point, double max_distance, SurfaceHit& hit) const noexcept {
  const double distance = (hollow_ ? -1 : 1) * (point.norm() - radius_);
  if (std::abs(distance) > max_distance) return false;
  hit = {};
  hit.distance = distance;
  hit.normal = normal(point);
  hit.point = point.normalized() * radius_;
  hit.object = hit.face = 0;
  return true;
}

FrictionResult run_friction(AnalyticSphere sphere, double static_friction, double dynamic_friction, double max_speed,
                            std::uint64_t cycles, std::uint64_t seed) {
  constexpr double kCycle = 1e-3, kTipRadius = 0.003;
  constexpr double kMinDepth = 0.0002, kMaxDepth = 0.002;  // m
  constexpr std::uint64_t kSegment = 400, kPause = 100;    // cycles
  std::mt19937_64 random{seed};
  std::normal_distribution<double> gaussian;
  std::uniform_real_distribution<double> uniform;
  Proxy proxy;
  proxy.set_grip({static_friction, dynamic_friction});
  FrictionResult result;

  // A surface point moves along a great circle whose direction changes slowly. The hand is below this point.
  Vec3d radial = Vec3d::UnitZ(), direction = Vec3d::UnitX();
  const double outwards = sphere.hollow() ? -1 : 1;
  const double contact_radius = sphere.radius() + outwards * kTipRadius;  // of the centre of a touching tip
  double speed = 0, depth = kMinDepth;
  (void)proxy.step(radial * (contact_radius + outwards * kTipRadius), kCycle, sphere, false);
  bool slipped = false;
  for (std::uint64_t i = 0; i < cycles; ++i) {
    if (i % kSegment == 0) speed = max_speed * uniform(random);
    const double step_length = i % kSegment < kSegment - kPause ? speed * kCycle : 0;
    direction = (direction + 0.02 * gaussian(random) * radial.cross(direction)).normalized();
    radial = Eigen::AngleAxisd{step_length / sphere.radius(), radial.cross(direction).normalized()} * radial;
    direction = (direction - radial * radial.dot(direction)).normalized();
    depth = std::clamp(depth + 2e-5 * gaussian(random), kMinDepth, kMaxDepth);
    const Vec3d device = radial * (contact_radius - outwards * depth);

    const Vec3d proxy_before = proxy.last().proxy;
    const ProxyResult& touch = proxy.step(device, kCycle, sphere, false);
    if (!touch.in_contact) continue;
    const Vec3d force = touch.proxy - device, normal = sphere.normal(touch.proxy);
    const double normal_force = force.dot(normal);
    const double ratio = (force - normal_force * normal).norm() / normal_force;
    if (touch.sticking) {
      ++result.sticking;
      result.max_stuck = std::max(result.max_stuck, ratio / static_friction);
      result.stick_error = std::max(result.stick_error, ratio / static_friction - 1);
      if (slipped) {
        ++result.stuck_again;
        result.max_return = std::max(result.max_return, ratio / static_friction);
      }
    } else {
      ++result.slipping;
      // Inside the dynamic cone the proxy rests, although the next motion would make it slip.
      const Vec3d displacement = touch.proxy - proxy_before;
      constexpr double kMinDisplacement = 1e-6;  // m
      if ((displacement - normal * normal.dot(displacement)).norm() > std::max(kMinDisplacement, step_length / 2))
        result.slip_error = std::max(result.slip_error, std::abs(ratio / dynamic_friction - 1));
    }
    slipped = !touch.sticking;
  }
  return result;
}

}  // namespace tactus::haptics::testing
