#include "hrtc_service/touch_object.hpp"

#include <algorithm>

namespace tactus::hrtc_service {

bool ObjectsSurface::sweep(const Vec3d& from, const Vec3d& to, double radius, haptics::SurfaceHit& hit) const noexcept {
  bool found = false;
  for (std::uint32_t i = 0; i < count_; ++i) {
    const TouchObject& object = *objects_[i];
    const Placement& placement = object.placement;
    spm::SweepContact touch;
    if (!object.forest->tree().sweep(placement.to_model(from), placement.to_model(to), radius / placement.scale(),
                                     touch))
      continue;
    if (found && !(touch.time < hit.time)) continue;
    found = true;
    hit = {};
    hit.time = touch.time;
    hit.point = placement.to_world(touch.point);
    hit.normal = placement.direction_to_world(touch.normal);
    hit.object = object.index;
    hit.face = spm::index(touch.face);
  }
  return found;
}

bool ObjectsSurface::closest(const Vec3d& point, double within, haptics::SurfaceHit& hit) const noexcept {
  // All faces that share the nearest point lie within a hair of its distance; more of them than fit share no vertex.
  constexpr double kHair = 1e-9;
  const double hair = kHair * (1 + within);
  using Rows = std::array<std::uint32_t, spm::AbTree::kMostNearest>;
  Rows rows;
  std::uint32_t found = 0;
  const TouchObject* nearest = nullptr;
  double reach = within;
  for (std::uint32_t i = 0; i < count_; ++i) {
    const TouchObject& object = *objects_[i];
    const double scale = object.placement.scale();
    spm::NearestFace face;
    Rows here;
    const std::uint32_t count = object.forest->tree().nearest(object.placement.to_model(point), reach / scale,
                                                              hair / scale, face, here.data(), here.size());
    if (count == 0) continue;
    nearest = &object;
    reach = std::sqrt(face.squared_distance) * scale;
    found = count;
    std::copy_n(here.begin(), count, rows.begin());
  }
  if (nearest == nullptr) return false;
  haptics::ClosestSide side{point, std::min(within, reach + hair)};
  const Placement& placement = nearest->placement;
  const spm::AbTree& tree = nearest->forest->tree();
  for (std::uint32_t i = 0; i < found; ++i) {
    const std::array<float, 9> corners = tree.corners(rows[i]);
    const auto corner = [&](int c) {
      return placement.to_world({corners[3 * c], corners[3 * c + 1], corners[3 * c + 2]});
    };
    side.offer(corner(0), corner(1), corner(2), nearest->index, tree.row(rows[i]).face);
  }
  return side.result(hit);
}

}  // namespace tactus::hrtc_service
