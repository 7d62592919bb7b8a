#include "spm/triangle.hpp"

#include <Eigen/Geometry>
#include <cmath>
#include <limits>

namespace tactus::spm {

bool swept_sphere(const Vec3d& from, const Vec3d& to, double radius, const Vec3d& a, const Vec3d& b, const Vec3d& c,
                  SweepHit& hit) noexcept {
  // Newton's method on distance(t) - radius. The function is convex and starts positive, so no iterate is after the
  // root. If an iterate is above 1 or the distance no longer shrinks, there is no contact.
  constexpr int kMaxSteps = 32;
  constexpr double kGraze = 1e-11;  // a miss by less than this share of the extent is a contact
  constexpr double kNoise = 1e-7;   // if the distance is below this share of the extent, its direction is not reliable
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
    // For a point (radius 0) on the triangle, the direction is rounding noise. The previous one states its side.
    if (!(distance > rounding)) break;
    const Vec3d direction = (centre - closest.point) / distance;
    if (!(motion.dot(direction) < 0)) {
      // If rounding has moved a point through a needle, this counts as a contact.
      if (distance - radius < kGraze * extent) break;
      return false;
    }
    normal = direction;
  }
  if (distance < kNoise * extent && closest.feature == Feature::kFace) {
    const Vec3d face_normal = (b - a).cross(c - a).stableNormalized();
    normal = face_normal.dot(motion) < 0 ? face_normal : Vec3d(-face_normal);
  }
  hit = {time, closest.point, normal, closest.feature};
  return true;
}

}  // namespace tactus::spm
