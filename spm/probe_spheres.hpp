/// Covers a probe's surface with spheres. Prediction and target selection use the spheres instead of the probe.
///
///        _______________________
///     (_)_(_)_(_)_(_)_(_)_(_)_(_)     a stylus; the first sphere is at its tip
///
/// Probe's frame and unit, unless stated otherwise.
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

/// A sphere of a probe in an object's model frame, in file units.
struct PlacedSphere {
  Vec3d centre = Vec3d::Zero();
  double radius = 0;
  Vec3d displacement = Vec3d::Zero();  ///< expected displacement within the look-ahead time of refinement
};

/// Returns 1 to `max` spheres that cover the probe's surface. The sphere nearest to the probe's origin, the tip, comes
/// first. Begins with one sphere around sample points of the whole surface. Then halves the bounding box of the largest
/// sphere's samples along its longest side, until there are `max` spheres or the largest radius is at most twice the
/// spacing of the samples. O(samples), allocates.
[[nodiscard]] std::vector<ProbeSphere> spheres_of(const MeshProbe& probe, std::uint32_t max);

/// The spheres in which the mesh must be at full resolution so that the contacts of a probe are exact.
class ProbeShape {
 public:
  /// More spheres fit the probe more closely, so fewer regions are refined, but target selection takes longer.
  static constexpr std::uint32_t kMaxSpheres = 8;

  /// The shape of a sphere around the origin. Allocates.
  explicit ProbeShape(double radius) : spheres_{{Vec3d::Zero(), radius}} {}
  /// The shape of a rigid mesh with the collision margin `margin`. Allocates.
  explicit ProbeShape(const MeshProbe& mesh, double margin = 0) : spheres_{spheres_of(mesh, kMaxSpheres)} {
    for (ProbeSphere& sphere : spheres_) sphere.radius += margin;
  }

  /// The spheres; that of the tip comes first.
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
