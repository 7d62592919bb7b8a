#include "sharing/scene.hpp"

#include <algorithm>

namespace tactus::sharing {

bool closest_of(std::span<const ScenePart> parts, const Vec3d& point, double max_distance, haptics::SurfaceHit& hit,
                const spm::CandidateCaches* caches) noexcept {
  // The faces around an edge or a vertex share the closest point, but rounding gives them different distances. So all
  // faces within `tolerance` of the smallest distance are offered to ClosestSide. If there are more than kMaxNearest of
  // them, they are assumed to share no vertex.
  constexpr double kRelativeTolerance = 1e-9;
  const double tolerance = kRelativeTolerance * (1 + max_distance);
  using LeafLanes = std::array<spm::LeafLane, spm::AbTree::kMaxNearest>;
  LeafLanes closest_lanes;
  std::uint32_t closest_count = 0;
  const ScenePart* closest_part = nullptr;
  double distance = max_distance;
  for (const ScenePart& part : parts) {
    const Placement& placement = *part.placement;
    const double scale = placement.scale();
    spm::NearestFace face;
    LeafLanes lanes;
    const std::uint32_t count = part.tree->nearest(placement.to_model(point), distance / scale, tolerance / scale, face,
                                                   lanes.data(), lanes.size(), caches);
    if (count == 0) continue;
    closest_part = &part;
    distance = std::sqrt(face.squared_distance) * scale;
    closest_count = count;
    std::copy_n(lanes.begin(), count, closest_lanes.begin());
  }
  if (closest_part == nullptr) return false;
  haptics::ClosestSide side{point, std::min(max_distance, distance + tolerance)};
  for (std::uint32_t i = 0; i < closest_count; ++i) {
    const std::array<float, 9> corners = closest_part->tree->corners(closest_lanes[i]);
    const auto corner = [&](int c) {
      return closest_part->placement->to_world({corners[3 * c], corners[3 * c + 1], corners[3 * c + 2]});
    };
    side.add_triangle(corner(0), corner(1), corner(2), closest_part->object,
                      index(closest_part->tree->face(closest_lanes[i])));
  }
  return side.result(hit);
}

}  // namespace tactus::sharing
