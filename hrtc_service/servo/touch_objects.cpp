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

std::optional<Arrival> TouchObjects::add(const ObjectDescription& description, const spm::BaseMesh& base,
                                         std::uint32_t max_pages) {
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
  object->summary = base.summary;
  object->grid.emplace(base.summary, max_pages);
  touch.forest = std::make_unique<spm::Forest>(pool_, nodes_, spm::ObjectIndex{touch.index}, base.summary,
                                               spm::RegionGrid{base.summary, max_pages}, std::move(admitted.base));
  objects_[description.index] = std::move(object);
  return Arrival{.kind = Arrival::Kind::kObject, .object = &touch};
}

spm::AcceptResult TouchObjects::add_page(std::uint32_t number, const spm::Page& page, Arrival& arrival) {
  Object* const object = not_withdrawn(number);
  if (object == nullptr || !spm::violations(object->summary, page).empty()) return spm::AcceptResult::kMalformed;
  auto added = std::make_unique<const spm::RegionPage>(page);
  if (const spm::RegionPage* const here = object->grid->find(page.id); here != nullptr)
    return *here == *added ? spm::AcceptResult::kLoaded : spm::AcceptResult::kMalformed;
  if (!object->grid->can_insert(*added)) return spm::AcceptResult::kMalformed;
  object->grid->insert(*added);
  arrival = {.kind = Arrival::Kind::kPage, .object = &object->touch, .page = added.get()};
  object->pages.push_back(std::move(added));
  return spm::AcceptResult::kAccepted;
}

std::optional<Arrival> TouchObjects::drop_page(std::uint32_t number, spm::PageId page) {
  Object* const object = not_withdrawn(number);
  const spm::RegionPage* const dropped = object == nullptr ? nullptr : object->grid->find(page);
  if (dropped == nullptr) return std::nullopt;
  object->grid->remove(*dropped);
  return Arrival{.kind = Arrival::Kind::kDropPage, .object = &object->touch, .page = dropped};
}

spm::AcceptResult TouchObjects::add_region(std::uint32_t number, const spm::RegionData& region,
                                           const spm::ListSummary& expected, Arrival& arrival) {
  Object* const object = not_withdrawn(number);
  if (object == nullptr) return spm::AcceptResult::kMalformed;
  spm::RegionList list;
  const spm::AcceptResult result = cache_.accept(object->cache_index, region, expected, list);
  if (result == spm::AcceptResult::kAccepted)
    arrival = {.kind = Arrival::Kind::kRegion, .object = &object->touch, .region = region.region, .list = list};
  return result;
}

std::optional<Arrival> TouchObjects::retire(std::uint32_t number, spm::RegionId region) {
  if (!is_in_use(number, region)) return std::nullopt;
  Object* const object = not_withdrawn(number);
  object->retired.insert(region);
  return Arrival{.kind = Arrival::Kind::kRetire, .object = &object->touch, .region = region};
}

std::optional<Arrival> TouchObjects::withdraw(std::uint32_t number) {
  Object* const object = not_withdrawn(number);
  if (object == nullptr) return std::nullopt;
  object->is_withdrawn = true;
  return Arrival{.kind = Arrival::Kind::kWithdraw, .object = &object->touch};
}

void TouchObjects::free(const Departure& departure) {
  std::unique_ptr<Object>& object = objects_[departure.object];
  if (departure.page != nullptr) {
    std::erase_if(object->pages, [&](const auto& page) { return page.get() == departure.page; });
    return;
  }
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
