#include "hrtc_service/servo/touch_object.hpp"

#include <algorithm>

namespace tactus::hrtc_service {

ObjectsSurface ObjectsSurface::on_meshes_before() const noexcept {
  ObjectsSurface before;
  for (std::uint32_t i = 0; i < count_; ++i) {
    const Entry& entry = entries_[i];
    if (!entry.unchanged.appeared) before.add(*entry.object, *entry.now, entry.previous, {});
  }
  before.version_ = spm::Version::kPrevious;
  before.caches_ = caches_;
  return before;
}

void ObjectsSurface::add_sweep_hit(const Entry& entry, const Vec3d& from_model, const Vec3d& to_model, double radius,
                                   bool& found, haptics::SurfaceHit& hit) noexcept {
  const Placement& placement = *entry.now;
  const double radius_model = radius / placement.scale();
  spm::SweepContact touch;
  const bool touches = entry.object->forest->tree().sweep(from_model, to_model, radius_model, touch, version_, caches_);
  const UnchangedSphere& unchanged = entry.unchanged;
  if (unchanged.squared_radius < std::numeric_limits<double>::infinity()) {
    constexpr double kRelativeTolerance = 1e-6;
    const Vec3d end = touches ? Vec3d(from_model + touch.time * (to_model - from_model)) : to_model;
    const Vec3d centre = vec(unchanged.centre);
    const double far = std::max((from_model - centre).norm(), (end - centre).norm());
    const double reach = (far + radius_model) * (1 + kRelativeTolerance);
    reached_change_ = reached_change_ || reach * reach >= unchanged.squared_radius;
  }
  if (!touches) return;
  if (found && !(touch.time < hit.time)) return;
  found = true;
  hit = {};
  hit.time = touch.time;
  hit.point = placement.to_world(touch.point);
  hit.normal = placement.direction_to_world(touch.normal);
  hit.object = entry.object->index;
  hit.face = spm::index(touch.face);
}

bool ObjectsSurface::sweep(const Vec3d& from, const Vec3d& to, double radius, haptics::SurfaceHit& hit) noexcept {
  bool found = false;
  for (std::uint32_t i = 0; i < count_; ++i) {
    const Placement& placement = *entries_[i].now;
    add_sweep_hit(entries_[i], placement.to_model(from), placement.to_model(to), radius, found, hit);
  }
  return found;
}

bool ObjectsSurface::sweep_moving(const Vec3d& from, const Vec3d& to, double radius,
                                  haptics::SurfaceHit& hit) noexcept {
  bool found = false;
  for (std::uint32_t i = 0; i < count_; ++i) {
    const Entry& entry = entries_[i];
    const Placement& before = entry.previous != nullptr ? *entry.previous : *entry.now;
    add_sweep_hit(entry, before.to_model(from), entry.now->to_model(to), radius, found, hit);
  }
  return found;
}

const ObjectsSurface::Entry* ObjectsSurface::moved(std::uint32_t object) const noexcept {
  if (moving_ > 0)
    for (std::uint32_t i = 0; i < count_; ++i)
      if (entries_[i].object->index == object) return entries_[i].previous != nullptr ? &entries_[i] : nullptr;
  return nullptr;
}

Vec3d ObjectsSurface::moved_point(std::uint32_t object, const Vec3d& point) const noexcept {
  const Entry* entry = moved(object);
  return entry != nullptr ? entry->now->to_world(entry->previous->to_model(point)) : point;
}

Vec3d ObjectsSurface::previous_point(std::uint32_t object, const Vec3d& point) const noexcept {
  const Entry* entry = moved(object);
  return entry != nullptr ? entry->previous->to_world(entry->now->to_model(point)) : point;
}

Vec3d ObjectsSurface::rotated_direction(std::uint32_t object, const Vec3d& direction) const noexcept {
  const Entry* entry = moved(object);
  return entry != nullptr ? entry->now->direction_to_world(entry->previous->direction_to_model(direction)) : direction;
}

bool ObjectsSurface::closest(const Vec3d& point, double within, haptics::SurfaceHit& hit) const noexcept {
  std::array<sharing::ScenePart, kMaxObjects> parts;
  for (std::uint32_t i = 0; i < count_; ++i)
    parts[i] = {&entries_[i].object->forest->tree(), entries_[i].now, entries_[i].object->index};
  return sharing::closest_of({parts.data(), count_}, point, within, hit, caches_);
}

}  // namespace tactus::hrtc_service
