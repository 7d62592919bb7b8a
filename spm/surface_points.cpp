#include "spm/surface_points.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace tactus::spm {
namespace {

using Eigen::Vector3d;

struct Candidate {
  Vector3d position, normal;
};

std::array<float, 3> floats_of(const Vector3d& v) {
  return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[2])};
}

}  // namespace

SurfacePoints surface_points(const BaseMesh& base, std::size_t max) {
  SurfacePoints out;
  if (base.faces.empty()) return out;
  std::vector<Candidate> candidates;
  for (const std::array<float, 3>& p : base.positions)
    candidates.push_back({{double{p[0]}, double{p[1]}, double{p[2]}}, Vector3d::Zero()});
  const auto corner = [&](const BaseFace& face, std::size_t k) -> Candidate& {
    return candidates[index(face.corners[k])];
  };
  std::vector<Candidate> centres;
  for (const BaseFace& face : base.faces) {
    const Vector3d a = corner(face, 0).position, b = corner(face, 1).position, c = corner(face, 2).position;
    const Vector3d twice_area = (b - a).cross(c - a);
    for (std::size_t k = 0; k < 3; ++k) corner(face, k).normal += twice_area;
    if (face.finest != 0) centres.push_back({(a + b + c) / 3, twice_area});
  }
  candidates.insert(candidates.end(), centres.begin(), centres.end());

  std::vector<double> distances(candidates.size(),
                                std::numeric_limits<double>::infinity());  // squared, to the nearest point
  std::size_t next = 0;
  while (out.points.size() < max && distances[next] > 0) {
    const Candidate& chosen = candidates[next];
    const double length = chosen.normal.norm();
    out.points.push_back(
        {floats_of(chosen.position), length > 0 ? floats_of(chosen.normal / length) : std::array<float, 3>{}});
    for (std::size_t i = 0; i < candidates.size(); ++i)
      distances[i] = std::min(distances[i], (candidates[i].position - chosen.position).squaredNorm());
    next = static_cast<std::size_t>(std::max_element(distances.begin(), distances.end()) - distances.begin());
  }

  // A part of the surface may have collapsed to a vertex without a face, so all vertices count too.
  out.spacing = std::sqrt(*std::max_element(distances.begin(), distances.end()));
  // The point of a face that is farthest from a surface point is a corner.
  for (const BaseFace& face : base.faces) {
    double covered = std::numeric_limits<double>::infinity();
    for (const SurfacePoint& point : out.points) {
      const Vector3d at{double{point.position[0]}, double{point.position[1]}, double{point.position[2]}};
      double furthest = 0;
      for (std::size_t k = 0; k < 3; ++k) furthest = std::max(furthest, (corner(face, k).position - at).norm());
      covered = std::min(covered, furthest);
    }
    out.spacing = std::max(out.spacing, covered);
  }
  out.spacing += base.summary.deviation;
  return out;
}

}  // namespace tactus::spm
