#include "spm/triangle.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

namespace tactus::spm {

bool swept_sphere(const Vec3d& from, const Vec3d& to, double radius, const Vec3d& a, const Vec3d& b, const Vec3d& c,
                  SweepHit& hit) noexcept {
  // Newton's method on distance(t) - radius. The function is convex and starts positive, so every iterate stays at or
  // before the root: an iterate past 1 or a distance that stops shrinking proves that there is no touch.
  constexpr int kMaxSteps = 32;
  constexpr double kGraze = 1e-11;  // a miss by less than this share of the extent is a contact
  constexpr double kNoise = 1e-7;   // below this share of the extent, centre minus contact has no reliable direction
  const Vec3d motion = to - from;
  const double extent = std::max({from.cwiseAbs().maxCoeff(), to.cwiseAbs().maxCoeff(), a.cwiseAbs().maxCoeff(),
                                  b.cwiseAbs().maxCoeff(), c.cwiseAbs().maxCoeff(), radius});
  const double rounding = 16 * std::numeric_limits<double>::epsilon() * extent;

  double time = 0;
  ClosestPoint closest = closest_point(from, a, b, c);
  double distance = std::sqrt(closest.squared_distance);
  Vec3d normal;
  if (distance > rounding) {
    normal = (from - closest.point) / distance;
  } else {
    normal = (b - a).cross(c - a).stableNormalized();
  }
  if (!(motion.dot(normal) < 0)) return false;

  for (int step = 0; step < kMaxSteps && distance - radius > rounding; ++step) {
    const double next = time - (distance - radius) / motion.dot(normal);
    if (!(next <= 1)) return false;
    if (next == time) break;
    time = next;
    const Vec3d centre = from + motion * time;
    closest = closest_point(centre, a, b, c);
    distance = std::sqrt(closest.squared_distance);
    // A point (radius 0) on the triangle has a noisy direction; the previous one gives the side from which it came.
    if (!(distance > rounding)) break;
    const Vec3d direction = (centre - closest.point) / distance;
    if (!(motion.dot(direction) < 0)) {
      // Rounding may have moved a point through a needle; this counts as a contact.
      if (distance - radius < kGraze * extent) break;
      return false;
    }
    normal = direction;
  }
  if (distance < kNoise * extent && closest.feature == Feature::kFace) {
    const Vec3d upright = (b - a).cross(c - a).stableNormalized();
    normal = upright.dot(motion) < 0 ? upright : Vec3d(-upright);
  }
  hit = {time, closest.point, normal, closest.feature};
  return true;
}

}  // namespace tactus::spm
