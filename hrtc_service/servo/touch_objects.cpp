#include "hrtc_service/servo/touch_objects.hpp"

#include <utility>

namespace tactus::hrtc_service {

TouchObjects::TouchObjects(const spm::PoolSettings& settings)
    : pool_{settings}, nodes_{settings.tree_nodes}, cache_{pool_} {}

TouchObjects::Object* TouchObjects::not_withdrawn(std::uint32_t object) const noexcept {
  if (object >= kMaxObjects || objects_[object] == nullptr || objects_[object]->is_withdrawn) return nullptr;
  return objects_[object].get();
}

TouchObject* TouchObjects::find(std::uint32_t object) noexcept {
  Object* const found = not_withdrawn(object);
  return found == nullptr ? nullptr : &found->touch;
}

const TouchObject* TouchObjects::find(std::uint32_t object) const noexcept {
  const Object* const found = not_withdrawn(object);
  return found == nullptr ? nullptr : &found->touch;
}

bool TouchObjects::is_in_use(std::uint32_t object, spm::RegionId region) const noexcept {
  const Object* const found = not_withdrawn(object);
  return found != nullptr && cache_.is_loaded(found->cache_index, region) && !found->retired.contains(region);
}

std::array<KeptObject, kMaxObjects> TouchObjects::kept_objects() const noexcept {
  std::array<KeptObject, kMaxObjects> objects;
  for (std::uint32_t i = 0; i < kMaxObjects; ++i)
    if (const Object* const object = objects_[i].get(); object != nullptr)
      objects[i] = {object->touch.id, object->touch.digest, true, object->is_withdrawn};
  return objects;
}

std::optional<Arrival> TouchObjects::add(const ObjectDescription& description, const spm::BaseMesh& base) {
  if (description.index >= kMaxObjects || objects_[description.index] != nullptr) return std::nullopt;
  spm::Cache::Admitted admitted = cache_.admit(base);
  if (!admitted.fits) return std::nullopt;
  auto object = std::make_unique<Object>();
  object->serial = ++added_;
  object->cache_index = admitted.object;
  TouchObject& touch = object->touch;
  static_cast<ObjectDescription&>(touch) = description;
  touch.bounds = spm::bounds_of(base.summary);
  touch.deviation = base.summary.deviation;
  touch.forest =
      std::make_unique<spm::Forest>(pool_, nodes_, spm::ObjectIndex{touch.index}, base.summary,
                                    spm::RegionGrid{base.summary.grid, base.regions}, std::move(admitted.base));
  objects_[description.index] = std::move(object);
  return Arrival{Arrival::Kind::kObject, &touch, {}, {}};
}

spm::AcceptResult TouchObjects::add_region(std::uint32_t number, const spm::RegionData& region,
                                           const spm::ListSummary& expected, Arrival& arrival) {
  Object* const object = not_withdrawn(number);
  if (object == nullptr) return spm::AcceptResult::kMalformed;
  spm::RegionList list;
  const spm::AcceptResult result = cache_.accept(object->cache_index, region, expected, list);
  if (result == spm::AcceptResult::kAccepted) arrival = {Arrival::Kind::kRegion, &object->touch, region.region, list};
  return result;
}

std::optional<Arrival> TouchObjects::retire(std::uint32_t number, spm::RegionId region) {
  if (!is_in_use(number, region)) return std::nullopt;
  Object* const object = not_withdrawn(number);
  object->retired.insert(region);
  return Arrival{Arrival::Kind::kRetire, &object->touch, region, {}};
}

std::optional<Arrival> TouchObjects::withdraw(std::uint32_t number) {
  Object* const object = not_withdrawn(number);
  if (object == nullptr) return std::nullopt;
  object->is_withdrawn = true;
  return Arrival{Arrival::Kind::kWithdraw, &object->touch, {}, {}};
}

void TouchObjects::free(const Departure& departure) {
  std::unique_ptr<Object>& object = objects_[departure.object];
  if (!departure.is_object()) {
    cache_.release(object->cache_index, departure.region);
    object->retired.erase(departure.region);
    return;
  }
  cache_.release_all(object->cache_index);
  cache_.remove(object->cache_index);
  object.reset();
}

}  // namespace tactus::hrtc_service
