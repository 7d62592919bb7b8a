/// Spheres that together hold a probe's surface: what stands for it where only spheres are asked about.
///
///        _______________________
///     (_)_(_)_(_)_(_)_(_)_(_)_(_)     a stylus, from its tip on
///
/// The largest is divided across its longest side until there are as many as may be. Probe's frame and unit.
#pragma once

#include <algorithm>
#include <vector>

#include "spm/mesh_probe.hpp"
#include "spm/span.hpp"

namespace tactus::spm {

struct ProbeSphere {
  Vec3d centre = Vec3d::Zero();
  double radius = 0;
};

/// One of the spheres that stand for a probe, in an object's model frame; file units.
struct PlacedSphere {
  Vec3d centre = Vec3d::Zero();
  double radius = 0;
  Vec3d ahead = Vec3d::Zero();  ///< where it goes while refinement looks ahead
};

/// At most `max` spheres, at least one; the one nearest to the probe's origin, where the tip is, comes first.
/// Allocates; O(area / size^2) of a fine sampling.
[[nodiscard]] std::vector<ProbeSphere> spheres_of(const MeshProbe& probe, std::uint32_t max);

/// Where an object's mesh has to be the finest one for a probe, whatever that is, so that its contacts are exact.
class ProbeShape {
 public:
  static constexpr std::uint32_t kMaxSpheres = 8;  ///< more would refine less, and take longer to ask

  /// A sphere about the origin.
  explicit ProbeShape(double radius) : spheres_{{Vec3d::Zero(), radius}} {}
  /// A rigid mesh that collides at a distance of `margin`. Allocates, as spheres_of.
  explicit ProbeShape(const MeshProbe& mesh, double margin = 0) : spheres_{spheres_of(mesh, kMaxSpheres)} {
    for (ProbeSphere& sphere : spheres_) sphere.radius += margin;
  }

  /// The tip's comes first.
  [[nodiscard]] Span<const ProbeSphere> spheres() const noexcept { return spheres_; }
  /// No point of the spheres is further from the origin.
  [[nodiscard]] double reach() const noexcept {
    double reach = 0;
    for (const ProbeSphere& sphere : spheres_) reach = std::max(reach, sphere.centre.norm() + sphere.radius);
    return reach;
  }

 private:
  std::vector<ProbeSphere> spheres_;
};

}  // namespace tactus::spm
