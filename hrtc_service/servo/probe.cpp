#include "hrtc_service/servo/probe.hpp"

#include <algorithm>

namespace tactus::hrtc_service {

const session::Material* ProbeStep::material(std::uint32_t object) const noexcept {
  for (std::uint32_t i = 0; i < surface.count(); ++i)
    if (surface[i].index == object) return &surface[i].material;
  return surface.count() > 0 ? &surface[0].material : nullptr;
}

void ProbeStep::mark_coarse(std::span<const TouchSphere> spheres) const noexcept {
  for (std::uint32_t i = 0; i < surface.count(); ++i) {
    const TouchObject& object = surface[i];
    const Placement& placement = surface.placement(i);
    const bool exact = std::all_of(spheres.begin(), spheres.end(), [&](const TouchSphere& sphere) {
      const spm::PlacedSphere sphere_in_model = placed(sphere, placement);
      return spm::is_exact(*object.forest, {&sphere_in_model, 1});
    });
    if (exact) continue;
    output.status &= ~static_cast<std::uint32_t>(session::kExact);
    output.error_bound = std::max(output.error_bound, static_cast<float>(object.deviation * placement.scale()));
  }
}

}  // namespace tactus::hrtc_service
