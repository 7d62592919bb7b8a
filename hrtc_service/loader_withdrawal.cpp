// Withdrawal: the loader removes the objects that no host offers any more.
#include <algorithm>
#include <utility>

#include "hrtc_service/loader.hpp"

namespace tactus::hrtc_service {

/// Removes an object from predictions, demands and the store. Its memory in the pool is freed when the intake has
/// returned it (free_withdrawn).
void Loader::withdraw(Object& object) {
  report_info("object " + object.info.name + ": withdrawn");
  object.withdrawn = true;
  active_.erase(std::find(active_.begin(), active_.end(), &object));
  delivery_.close(object.info.id);
  drop_waiting(object);
  broad_phase_.remove(object.info.index);
  // These lists may refer to regions of the object.
  predicted_contacts_.clear();
  last_prediction_ns_ = next_prediction_ns_ = 0;
  object.wanted_regions.clear();
  pool_targets_.erase(std::remove_if(pool_targets_.begin(), pool_targets_.end(),
                                     [&](const RegionRef& target) { return target.object == &object; }),
                      pool_targets_.end());

  const spm::ObjectIndex number{object.info.index};
  for (const std::uint32_t region : object.held) {
    store_.retire(number, spm::RegionId{region});
    evict(object, region);
  }
  object.held.clear();
  const auto evict_own = [&](const RegionRef& candidate) {
    if (candidate.object == &object) evict(object, candidate.region);
    return candidate.object == &object;
  };
  eviction_candidates_.erase(std::remove_if(eviction_candidates_.begin(), eviction_candidates_.end(), evict_own),
                             eviction_candidates_.end());
  store_.remove(number);

  intake_.withdraw(object.info.index);
  if (on_object_withdrawn) on_object_withdrawn(object.described);
  intake_.flush();
}

/// Frees an object that the intake has returned, and opens postponed objects.
void Loader::free_withdrawn(Object& object) {
  for (const auto& page : object.pages)
    for (const RegionProgress& note : page->notes)
      figures_.regions_coarsened += note.pool_state() != PoolState::kNotLoaded ? 1 : 0;
  departing_.erase(std::remove_if(departing_.begin(), departing_.end(),
                                  [&](const Departing& departing) { return departing.object == &object; }),
                   departing_.end());
  base_slots_ -= object.base_slots;
  base_nodes_ -= object.base_nodes;
  release_directory(object);
  by_index_[object.info.index] = nullptr;
  if (object.refused) {
    keep_refused(object);
    return;
  }
  report_info("object " + object.info.name + ": freed");
  forget(object);
  open_postponed();
}

/// Keeps an object that the intake has refused, so that no later catalogue entry opens it again.
void Loader::keep_refused(Object& object) {
  ++figures_.objects_refused;
  auto kept = std::make_unique<Object>(object.entry, 0);
  kept->info.name = object.info.name;
  kept->info.id = object.info.id;
  kept->info.digest = object.info.digest;
  kept->info.scale = object.info.scale;
  kept->refused = true;
  forget(object);
  objects_[kept->info.id] = std::move(kept);
}

void Loader::forget(Object& object) {
  const ObjectInfo info = std::move(object.info);
  objects_.erase(info.id);
  if (on_object_gone) on_object_gone(info);
}

/// Stores the entry of an object that cannot be opened now, for lack of space or because its name is in use. Removes
/// entries that no host offers any more.
void Loader::postpone(const session::CatalogueEntry& entry) {
  for (auto at = postponed_.begin(); at != postponed_.end();)
    at = delivery_.is_offered(at->first, at->second.summary.digest) ? std::next(at) : postponed_.erase(at);
  if (postponed_.size() < kMaxObjects) postponed_[entry.object_id] = entry;
}

/// Opens the refused and postponed objects that hosts still offer. Called when an object was removed.
void Loader::open_postponed() {
  std::vector<Object*> refused;
  for (const auto& [id, object] : objects_)
    if (object->refused) refused.push_back(object.get());
  for (Object* const object : refused) {
    postponed_.try_emplace(object->info.id, object->entry);
    delivery_.close(object->info.id);
    forget(*object);
  }
  for (const auto& [id, entry] : std::exchange(postponed_, {}))
    if (delivery_.is_offered(id, entry.summary.digest)) open(entry);
}

}  // namespace tactus::hrtc_service
