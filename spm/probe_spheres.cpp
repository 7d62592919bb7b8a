#include "spm/probe_spheres.hpp"

#include <algorithm>
#include <cmath>

namespace tactus::spm {
namespace {

constexpr double kSpacing = 1.0 / 128;  // distance between samples, in radii of the probe

struct Cluster {
  std::vector<Vec3d> points;
  Vec3d low, high;
  ProbeSphere sphere;
};

Cluster cluster_of(std::vector<Vec3d> points) {
  Cluster cluster{std::move(points), {}, {}, {}};
  cluster.low = cluster.high = cluster.points.front();
  for (const Vec3d& p : cluster.points) {
    cluster.low = cluster.low.cwiseMin(p);
    cluster.high = cluster.high.cwiseMax(p);
  }
  cluster.sphere.centre = (cluster.low + cluster.high) / 2;
  for (const Vec3d& p : cluster.points)
    cluster.sphere.radius = std::max(cluster.sphere.radius, (p - cluster.sphere.centre).norm());
  return cluster;
}

/// Returns samples of the surface. Every point of the surface is within `spacing` of a sample.
std::vector<Vec3d> samples_of(const MeshProbe& probe, double spacing) {
  const auto& at = probe.vertices();
  std::vector<Vec3d> points;
  for (std::uint32_t t = 0; t < probe.triangles(); ++t) {
    std::array<Vec3d, 3> corner;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t v = probe.corners(t)[i];
      corner[i] = {at[0][v], at[1][v], at[2][v]};
    }
    const Vec3d ab = corner[1] - corner[0], ac = corner[2] - corner[0];
    const double longest = std::max({ab.norm(), ac.norm(), (ab - ac).norm()});
    const int parts = 1 + static_cast<int>(longest / spacing);
    for (int i = 0; i <= parts; ++i)
      for (int j = 0; i + j <= parts; ++j)
        points.push_back(corner[0] + ab * (double(i) / parts) + ac * (double(j) / parts));
  }
  return points;
}

}  // namespace

std::vector<ProbeSphere> spheres_of(const MeshProbe& probe, std::uint32_t max) {
  const double spacing = std::max(kSpacing * probe.radius(), 1e-12);
  std::vector<Cluster> clusters{cluster_of(samples_of(probe, spacing))};
  while (clusters.size() < max) {
    const auto largest = std::max_element(clusters.begin(), clusters.end(), [](const Cluster& a, const Cluster& b) {
      return a.sphere.radius < b.sphere.radius;
    });
    if (largest->sphere.radius <= 2 * spacing) break;
    int axis = 0;
    (largest->high - largest->low).maxCoeff(&axis);
    const double middle = largest->sphere.centre[axis];
    const auto second = std::partition(largest->points.begin(), largest->points.end(),
                                       [&](const Vec3d& p) { return p[axis] < middle; });
    std::vector<Vec3d> above{second, largest->points.end()};
    largest->points.erase(second, largest->points.end());
    *largest = cluster_of(std::move(largest->points));
    clusters.push_back(cluster_of(std::move(above)));
  }
  std::vector<ProbeSphere> spheres;
  const double between = spacing / std::sqrt(3);  // maximum distance of the surface from a sample
  for (const Cluster& cluster : clusters) spheres.push_back({cluster.sphere.centre, cluster.sphere.radius + between});
  const auto tip = std::min_element(spheres.begin(), spheres.end(), [](const ProbeSphere& a, const ProbeSphere& b) {
    return a.centre.norm() - a.radius < b.centre.norm() - b.radius;
  });
  std::iter_swap(spheres.begin(), tip);
  return spheres;
}

}  // namespace tactus::spm
