#include "hrtc_service/servo/contact_query.hpp"

#include <algorithm>
#include <limits>

namespace tactus::hrtc_service {

void ContactQuery::run(std::uint32_t probe, const Vec3d& tip, std::int64_t now_ns, const ObjectsSurface& surface,
                       const std::array<std::uint32_t, kMaxObjects>& cycles_since_change,
                       ProbeOutput& output) noexcept {
  bool exact = tip.allFinite();
  float bound = exact ? 0 : std::numeric_limits<float>::max();
  for (std::uint32_t i = 0; i < surface.count(); ++i) {
    const TouchObject& object = surface[i];
    const Placement& placement = surface.placement(i);
    const spm::PlacedSphere sphere = placed({tip, Vec3d::Zero(), radius_}, placement);
    const bool object_exact = spm::is_exact(*object.forest, {&sphere, 1});
    std::uint32_t found =
        object.forest->tree().find_contacts(sphere.centre, sphere.radius, contacts_.data(), kMaxContacts);
    const bool truncated = found > kMaxContacts;
    if (truncated) output.status |= session::kContactsTruncated;
    found = std::min(found, kMaxContacts);
    // All cells in the sphere are at full resolution. A coarse face in the sphere replaces finest faces of a cell
    // outside the sphere, so it is no contact.
    if (object_exact) {
      const auto end = std::remove_if(contacts_.begin(), contacts_.begin() + found,
                                      [](const spm::Contact& c) { return !c.is_finest(); });
      found = static_cast<std::uint32_t>(end - contacts_.begin());
    } else {
      bound = std::max(bound, static_cast<float>(object.deviation * placement.scale()));
    }
    exact = exact && object_exact;
    output.contacts += found;
    if (!log_) continue;
    entry_.time_ns = now_ns;
    entry_.probe = probe;
    entry_.since_change = cycles_since_change[object.index];
    entry_.exact = object_exact;
    entry_.truncated = truncated;
    log(object, sphere.centre, sphere.radius, found);
  }
  if (exact) output.status |= session::kExact;
  output.error_bound = bound;
}

/// Logs the contacts, if the sphere touches a face or a labelled cell.
void ContactQuery::log(const TouchObject& object, const Vec3d& centre, double radius, std::uint32_t found) noexcept {
  bool in_cell = found > 0;
  if (!in_cell)
    object.forest->grid().for_each_intersecting(centre, radius, [&](spm::RegionId, double) { in_cell = true; });
  if (!in_cell) return;
  entry_.object = object.index;
  entry_.centre = plain(centre);
  entry_.radius = radius;
  entry_.mesh_hash = object.forest->mesh_hash();
  entry_.truncated = entry_.truncated || found > trace::LoggedQuery::kMaxContacts;
  entry_.contact_count = std::min(found, trace::LoggedQuery::kMaxContacts);
  for (std::uint32_t i = 0; i < entry_.contact_count; ++i)
    entry_.contacts[i] = {trace::triangle_key(object.forest->tree().corners(contacts_[i])),
                          static_cast<float>(contacts_[i].depth(centre, radius))};
  if (!log_->push(entry_)) ++log_dropped_;
}

}  // namespace tactus::hrtc_service
