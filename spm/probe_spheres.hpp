/// Balls that together hold a probe's surface: what stands for it where only balls are asked about.
///
///        _______________________
///     (_)_(_)_(_)_(_)_(_)_(_)_(_)     a stylus, from its tip on
///
/// The largest is divided across its longest side until there are as many as may be. Probe's frame and unit.
#pragma once

#include <vector>

#include "spm/mesh_probe.hpp"

namespace tactus::spm {

struct ProbeSphere {
  Vec3d centre = Vec3d::Zero();
  double radius = 0;
};

/// At most `most` balls, at least one; the one nearest to the probe's origin, where the tip is, comes first. Allocates;
/// O(area / size^2) of a fine sampling.
[[nodiscard]] std::vector<ProbeSphere> spheres_of(const MeshProbe& probe, std::uint32_t max);

}  // namespace tactus::spm
