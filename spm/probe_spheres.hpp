/// Spheres that together cover a probe's surface. Prediction and target selection use them instead of the probe.
///
///        _______________________
///     (_)_(_)_(_)_(_)_(_)_(_)_(_)     a stylus; the first sphere is at its tip
///
/// The largest sphere is divided across its longest side until the maximum number is reached. Probe's frame and unit.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "spm/mesh_probe.hpp"

namespace tactus::spm {

struct ProbeSphere {
  Vec3d centre = Vec3d::Zero();
  double radius = 0;
};

/// One of these spheres in an object's model frame; file units.
struct PlacedSphere {
  Vec3d centre = Vec3d::Zero();
  double radius = 0;
  Vec3d ahead = Vec3d::Zero();  ///< its motion during the look-ahead time of refinement
};

/// At most `max` spheres, at least one. The sphere nearest to the probe's origin, the tip, comes first. Samples the
/// surface finely: O(area / spacing^2). Allocates.
[[nodiscard]] std::vector<ProbeSphere> spheres_of(const MeshProbe& probe, std::uint32_t max);

/// The spheres in which the mesh must be at full resolution so that the contacts of a probe are exact.
class ProbeShape {
 public:
  static constexpr std::uint32_t kMaxSpheres = 8;  ///< more would refine less of the mesh, but take longer to query

  /// One sphere around the origin.
  explicit ProbeShape(double radius) : spheres_{{Vec3d::Zero(), radius}} {}
  /// A rigid mesh with the collision margin `margin`. Allocates, as spheres_of.
  explicit ProbeShape(const MeshProbe& mesh, double margin = 0) : spheres_{spheres_of(mesh, kMaxSpheres)} {
    for (ProbeSphere& sphere : spheres_) sphere.radius += margin;
  }

  /// The tip's comes first.
  [[nodiscard]] std::span<const ProbeSphere> spheres() const noexcept { return spheres_; }
  /// Maximum distance of a point of the spheres from the origin.
  [[nodiscard]] double reach() const noexcept {
    double reach = 0;
    for (const ProbeSphere& sphere : spheres_) reach = std::max(reach, sphere.centre.norm() + sphere.radius);
    return reach;
  }

 private:
  std::vector<ProbeSphere> spheres_;
};

}  // namespace tactus::spm
