#include "sharing/scene.hpp"

#include <algorithm>

namespace tactus::sharing {

bool closest_of(std::span<const ScenePart> parts, const Vec3d& point, double within, haptics::SurfaceHit& hit,
                const spm::CandidateCaches* caches) noexcept {
  // Faces that share the nearest point lie within kHair of its distance. If more do than fit, they share no vertex.
  constexpr double kHair = 1e-9;
  const double hair = kHair * (1 + within);
  using Rows = std::array<spm::RowIndex, spm::AbTree::kMaxNearest>;
  Rows rows;
  std::uint32_t found = 0;
  const ScenePart* nearest = nullptr;
  double reach = within;
  for (const ScenePart& part : parts) {
    const Placement& placement = *part.placement;
    const double scale = placement.scale();
    spm::NearestFace face;
    Rows here;
    const std::uint32_t count = part.tree->nearest(placement.to_model(point), reach / scale, hair / scale, face,
                                                   here.data(), here.size(), caches);
    if (count == 0) continue;
    nearest = &part;
    reach = std::sqrt(face.squared_distance) * scale;
    found = count;
    std::copy_n(here.begin(), count, rows.begin());
  }
  if (nearest == nullptr) return false;
  haptics::ClosestSide side{point, std::min(within, reach + hair)};
  for (std::uint32_t i = 0; i < found; ++i) {
    const std::array<float, 9> corners = nearest->tree->corners(rows[i]);
    const auto corner = [&](int c) {
      return nearest->placement->to_world({corners[3 * c], corners[3 * c + 1], corners[3 * c + 2]});
    };
    side.offer(corner(0), corner(1), corner(2), nearest->object, index(nearest->tree->row(rows[i]).face));
  }
  return side.result(hit);
}

}  // namespace tactus::sharing
