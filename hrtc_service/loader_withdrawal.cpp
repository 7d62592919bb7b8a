// The loader's half that lets objects go which no host offers any more.
#include <algorithm>
#include <utility>

#include "hrtc_service/loader.hpp"

namespace tactus::hrtc_service {

/// At once, but for what the haptic thread uses: that is freed when the object departs.
void Loader::withdraw(Object& object) {
  say("object " + object.info.name + ": withdrawn");
  object.withdrawn = true;
  active_.erase(std::find(active_.begin(), active_.end(), &object));
  delivery_.close(object.info.id);
  drop_parked(object);
  broad_phase_.remove(object.info.index);
  // What was predicted and is due names its regions.
  prospects_.clear();
  predicted_ns_ = predict_next_ns_ = 0;
  object.wishes.clear();
  due_.erase(std::remove_if(due_.begin(), due_.end(), [&](const Place& place) { return place.object == &object; }),
             due_.end());

  const spm::ObjectIndex number{object.info.index};
  for (const std::uint32_t region : object.held) {
    store_.leave(number, spm::RegionId{region});
    evict(object, region);
  }
  object.held.clear();
  const auto leaves = [&](const Place& place) {
    if (place.object == &object) evict(object, place.region);
    return place.object == &object;
  };
  eviction_candidates_.erase(std::remove_if(eviction_candidates_.begin(), eviction_candidates_.end(), leaves),
                             eviction_candidates_.end());
  store_.remove(number);

  waiting_.push_back({Arrival::Kind::kWithdraw, &object.touch, {}, {}});
  if (on_object_withdrawn) on_object_withdrawn(object.touch);
  hand_over();
}

/// The haptic thread has forgotten it.
void Loader::free_withdrawn(Object& object) {
  const spm::ObjectIndex number{object.info.index};
  for (std::uint32_t region = 0; region < object.notes.size(); ++region)
    if (object.notes[region].shown() != Shown::kNot) {
      cache_.release(number, spm::RegionId{region});
      ++figures_.regions_coarsened;
    }
  departing_.erase(std::remove_if(departing_.begin(), departing_.end(),
                                  [&](const Departing& departing) { return departing.object == &object; }),
                   departing_.end());
  cache_.remove(number);
  base_slots_ -= object.base_slots;
  base_nodes_ -= object.base_nodes;
  directories_ -= spm::directory_bytes(object.summary, pool_.settings);
  by_index_[object.info.index] = nullptr;
  say("object " + object.info.name + ": freed");
  forget(object);
  open_postponed();
}

void Loader::forget(Object& object) {
  const ObjectInfo info = std::move(object.info);
  objects_.erase(info.id);
  if (on_object_gone) on_object_gone(info);
}

/// Until there is room for it, or until the object of that name is gone.
void Loader::postpone(const session::CatalogueEntry& entry) {
  for (auto at = postponed_.begin(); at != postponed_.end();)
    at = delivery_.offered(at->first, at->second.summary.digest) ? std::next(at) : postponed_.erase(at);
  if (postponed_.size() < kMaxObjects) postponed_[entry.object_id] = entry;
}

/// There is more room: what was refused or postponed is tried again, when it is still offered.
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
    if (delivery_.offered(id, entry.summary.digest)) open(entry);
}

}  // namespace tactus::hrtc_service
