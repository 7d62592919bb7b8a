#include "viewer/screen_refinement.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "spm/finest_tree.hpp"

namespace tactus::viewer {

using spm::Vec3d;

std::vector<BaseRegion> base_regions(const spm::Forest& forest) {
  const spm::RegionGrid& grid = forest.grid();
  std::vector<BaseRegion> regions(grid.size());
  std::vector<spm::RegionId> found;
  for (const spm::BaseSlots::Face& face : forest.base().faces) {
    const std::array<Vec3d, 3> corners = spm::shown_corners(forest.tree(), forest.shown_at(face.row));
    const Vec3d centre = (corners[0] + corners[1] + corners[2]) / 3;
    double radius = 0;
    for (const Vec3d& corner : corners) radius = std::max(radius, (corner - centre).norm());
    const float error = spm::radius_of(face.radius);
    const auto add = [&](spm::RegionId region) {
      BaseRegion& each = regions[spm::index(region)];
      each.error = std::max(each.error, error);
      ++each.faces;
    };
    found.clear();
    if (!grid.for_each_intersecting(centre, radius, [&](spm::RegionId region, double) { found.push_back(region); })) {
      found.clear();
      for (std::uint32_t region = 0; region < grid.size(); ++region)
        if (grid.has(spm::RegionId{region}) &&
            grid.box(spm::RegionId{region}).squared_distance(centre) <= radius * radius)
          found.push_back(spm::RegionId{region});
    }
    for (const spm::RegionId region : found) add(region);
  }
  return regions;
}

void ScreenRefinement::add(std::uint32_t object_index, std::uint32_t region, const BaseRegion& base,
                           const spm::CellBox& box, const sharing::Placement& placement, std::uint32_t entries,
                           double distinct, const std::map<std::uint64_t, Camera>& cameras) {
  const Vec3d middle = placement.to_world((box.low + box.high) / 2);
  const double radius = placement.scale() * (box.high - box.low).norm() / 2;
  double pixels = 0;
  for (const auto& [page, camera] : cameras) {
    const Vec3d towards = middle - camera.position;
    const double distance = towards.norm(), nearest = std::max(distance - radius, 1e-3);
    const bool is_around = distance <= radius;
    const double angle = is_around ? 0 : std::acos(std::clamp(towards.dot(camera.direction) / distance, -1.0, 1.0));
    const double half_size = is_around ? 0 : std::asin(radius / distance);
    if (angle - half_size > camera.half_angle) continue;
    pixels = std::max(pixels, base.error * placement.scale() / (nearest * camera.pixel));
  }
  if (std::isfinite(pixels) && pixels > kMinPixels && entries > 0)
    candidates_.push_back({object_index, region, pixels, std::max(base.faces, 1u), entries, distinct});
}

/// In eighths of the list, so that a small motion of a camera changes nothing.
std::uint32_t ScreenRefinement::Candidate::entries_for(double max_pixels) const noexcept {
  if (pixels <= max_pixels) return 0;
  const double needed = base_faces * (pixels / max_pixels - 1) / 2;  // an entry adds two faces
  const double eighths = std::ceil(8 * needed / entries);
  return eighths >= 8 ? entries : static_cast<std::uint32_t>(std::ceil(eighths * entries / 8));
}

std::map<std::uint32_t, std::map<std::uint32_t, std::uint32_t>> ScreenRefinement::choose(std::uint32_t faces,
                                                                                         std::uint32_t records) const {
  const auto fits = [&](double max_pixels) {
    double added_faces = 0, listed = 0;
    for (const Candidate& each : candidates_) {
      const std::uint32_t entries = each.entries_for(max_pixels);
      added_faces += 2 * entries * each.distinct;
      listed += entries > 0 ? each.entries * each.distinct : 0;
    }
    return added_faces <= faces && listed <= records;
  };
  double high = kMinPixels;
  for (const Candidate& each : candidates_) high = std::max(high, each.pixels);
  double low = kMinPixels;
  if (fits(low)) high = low;
  constexpr double kPrecision = 1.02;
  while (high / low > kPrecision) {
    const double middle = std::sqrt(low * high);
    (fits(middle) ? high : low) = middle;
  }
  std::map<std::uint32_t, std::map<std::uint32_t, std::uint32_t>> chosen;
  for (const Candidate& each : candidates_)
    if (const std::uint32_t entries = each.entries_for(high); entries > 0)
      chosen[each.object_index][each.region] = entries;
  return chosen;
}

}  // namespace tactus::viewer
