// The pool: decodes the regions that probes will touch soonest, sends them to the intake, and frees memory for them.
#include <algorithm>
#include <utility>

#include "hrtc_service/loader.hpp"

namespace tactus::hrtc_service {
namespace {

/// Returns the space that stays free when a region with a later contact is loaded. Contacts that the prediction misses
/// use this space.
spm::Cache::Space reserve_of(const spm::PoolSettings& pool) noexcept {
  return {pool.slots / 16, pool.list_blocks / 16};
}

}  // namespace

double Loader::slot_estimate(const Object& object, std::uint32_t region) const noexcept {
  return object.list(region).records *
         (static_cast<double>(object.summary.parts) / std::max(object.summary.records, 1u));
}

spm::Cache::Space Loader::space_to_load(const Object& object, std::uint32_t region) const noexcept {
  return {static_cast<std::uint32_t>(undecoded_share_ * slot_estimate(object, region)),
          spm::ListBlock::blocks_for(object.list(region).records)};
}

/// Decodes the regions that probes will touch soonest. If a region with contact within kSoon does not fit, its space is
/// added to `missing_space_`, and `coarsen` frees it. Regions with a later contact use free memory only.
void Loader::load_soonest() {
  constexpr double kSoon = 0.03;        // s
  constexpr int kMaxEarlyLoads = 16;    // max regions with contact later than kSoon, decoded in one tick
  constexpr double kUsableShare = 0.9;  // share of the slots that base meshes do not occupy
  for (const RegionRef& target : pool_targets_) target.object->note(target.region).belongs_in_pool = 0;
  pool_targets_.clear();
  std::stable_sort(
      predicted_contacts_.begin(), predicted_contacts_.end(),
      [](const PredictedContact& a, const PredictedContact& b) { return a.time_to_contact < b.time_to_contact; });
  const double usable_slots = kUsableShare * (pool_.slots - base_slots_);
  spm::Cache::Space reserve = reserve_of(pool_);
  reserve.slots += pending_base_slots();
  missing_space_ = {};
  bool is_full = false;
  int early_loads = 0;
  double slots = 0;
  for (const PredictedContact& contact : predicted_contacts_) {
    Object& object = *contact.object;
    RegionProgress& note = object.note(contact.region);
    const spm::Cache::Space cost = space_to_load(object, contact.region);
    slots += cost.slots;
    if (slots > usable_slots && contact.time_to_contact > 0) break;
    note.belongs_in_pool = 1;
    pool_targets_.push_back({&object, contact.region});
    if (note.pool_state() != PoolState::kNotLoaded || note.store_state() == StoreState::kAbsent || note.is_faulty != 0)
      continue;
    if (contact.time_to_contact > kSoon) {
      const spm::Cache::Space& free = intake_.free_space();
      const bool fits = free.slots >= cost.slots + reserve.slots && free.blocks >= cost.blocks + reserve.blocks;
      if (fits && !is_full && early_loads++ < kMaxEarlyLoads) static_cast<void>(load(object, contact.region));
      continue;
    }
    const spm::Cache::Space missing = is_full ? cost : load(object, contact.region);
    is_full = missing.slots > 0;
    missing_space_.slots += missing.slots;
    missing_space_.blocks += missing.blocks;
  }
}

spm::Cache::Space Loader::load(Object& object, std::uint32_t region) {
  const spm::ObjectIndex number{object.info.index};
  const spm::RegionData* data = store_.get(number, spm::RegionId{region});
  if (data == nullptr) {
    mark_faulty(object, region);
    return {};
  }
  const auto parts = static_cast<std::uint32_t>(data->parts.size());
  const std::uint32_t blocks = spm::ListBlock::blocks_for(object.list(region).records);
  if (parts > intake_.free_space().slots || blocks > intake_.free_space().blocks) return {std::max(parts, 1u), blocks};
  const double slots = slot_estimate(object, region);
  if (slots > 0) undecoded_share_ += 0.1 * (static_cast<double>(parts) / slots - undecoded_share_);
  intake_.add_region(object.info.index, *data, object.list(region));
  mark_loaded(object, region);
  figures_.slots_peak = std::max(figures_.slots_peak, slots_used());
  return {};
}

void Loader::mark_loaded(Object& object, std::uint32_t region) {
  if (object.note(region).store_state() != StoreState::kAbsent)
    store_.mark_loaded(spm::ObjectIndex{object.info.index}, spm::RegionId{region});
  object.note(region).set(PoolState::kLoaded);
  object.loaded.push_back(region);
}

/// The intake has the region no longer, or will free it: later messages contain its records again.
void Loader::mark_unloaded(Object& object, std::uint32_t region) {
  if (object.note(region).store_state() != StoreState::kAbsent)
    store_.mark_unloaded(spm::ObjectIndex{object.info.index}, spm::RegionId{region});
  object.loaded.erase(std::find(object.loaded.begin(), object.loaded.end(), region));
}

/// Orders the haptic thread to coarsen regions, the longest unwanted first, until enough space will be free: for the
/// pending base meshes, and for the missing regions or the reserve, whichever is larger. At most kMaxDeparting regions
/// are being coarsened at a time: with fewer, a fast tip waits for memory (docs/decisions/0046-intake.md).
void Loader::coarsen() {
  constexpr std::size_t kMaxDeparting = 64;
  const spm::Cache::Space reserve = reserve_of(pool_);
  const spm::Cache::Space target{std::max(missing_space_.slots, reserve.slots) + pending_base_slots(),
                                 std::max(missing_space_.blocks, reserve.blocks)};
  spm::Cache::Space expected = intake_.free_space();
  for (const Departing& departing : departing_) {
    expected.slots += departing.space.slots;
    expected.blocks += departing.space.blocks;
  }
  const auto has_enough = [&] { return expected.slots >= target.slots && expected.blocks >= target.blocks; };
  if (has_enough() || departing_.size() >= kMaxDeparting) return;
  struct Candidate {
    std::int64_t unwanted_ns;
    Object* object;
    std::uint32_t region;
  };
  std::vector<Candidate> candidates;
  for (Object* object : active_)
    for (const std::uint32_t region : object->loaded) {
      const RegionProgress& note = object->note(region);
      if (note.belongs_in_pool == 0) candidates.push_back({note.unwanted_ns(last_tick_ns_), object, region});
    }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.unwanted_ns > b.unwanted_ns; });
  for (const Candidate& candidate : candidates) {
    if (has_enough() || departing_.size() >= kMaxDeparting) return;
    Object& object = *candidate.object;
    mark_unloaded(object, candidate.region);
    object.note(candidate.region).set(PoolState::kDeparting);
    // Like a region that arrives, one that departs shares some of its records with others.
    const spm::Cache::Space space = space_to_load(object, candidate.region);
    departing_.push_back({&object, candidate.region, space});
    expected.slots += space.slots;
    expected.blocks += space.blocks;
    intake_.retire(object.info.index, spm::RegionId{candidate.region});
  }
}

void Loader::process_answers() {
  IntakeAnswer answer;
  while (intake_.take(answer)) {
    if (answer.object >= kMaxObjects) continue;
    if (answer.kind == IntakeAnswer::Kind::kObjectGone && std::exchange(kept_objects_[answer.object], {}).exists)
      open_postponed();  // refused objects may fit now
    if (by_index_[answer.object] == nullptr) continue;
    Object& object = *by_index_[answer.object];
    const std::uint32_t region = spm::index(answer.region);
    switch (answer.kind) {
      case IntakeAnswer::Kind::kObject:
        if (answer.result == spm::AcceptResult::kAccepted || answer.result == spm::AcceptResult::kLoaded) break;
        report_warning("object " + object.info.name + ": refused by the intake of the servo");
        object.refused = true;
        if (!object.withdrawn) withdraw(object);  // the intake answers that the object is gone
        break;
      case IntakeAnswer::Kind::kDiffers:  // opened again as soon as it is gone
        postpone(object.entry);
        if (!object.withdrawn) withdraw(object);
        break;
      case IntakeAnswer::Kind::kRegion:
        if (object.withdrawn) break;
        if (object.find_page(region) != nullptr)
          process_region_answer(object, region, answer.result);
        else if (answer.result == spm::AcceptResult::kLoaded)
          object.regions_in_servo.push_back(region);
        break;
      case IntakeAnswer::Kind::kPage:
        if (!object.withdrawn) process_page_answer(object, spm::PageId{region}, answer.result);
        break;
      case IntakeAnswer::Kind::kRegionGone:
        if (object.find_page(region) == nullptr) {  // an earlier gateway has retired it
          std::erase(object.regions_in_servo, region);
          break;
        }
        end_departure(object, region);
        ++figures_.regions_coarsened;
        break;
      case IntakeAnswer::Kind::kObjectGone:
        free_withdrawn(object);
        break;
      case IntakeAnswer::Kind::kOther:
        break;
    }
  }
}

void Loader::end_departure(Object& object, std::uint32_t region) {
  // An earlier gateway may have retired the region.
  if (object.note(region).pool_state() == PoolState::kLoaded) mark_unloaded(object, region);
  object.note(region).set(PoolState::kNotLoaded);
  std::erase_if(departing_,
                [&](const Departing& departing) { return departing.object == &object && departing.region == region; });
}

/// After a refusal, later messages contain the records of the region again.
void Loader::process_region_answer(Object& object, std::uint32_t region, spm::AcceptResult result) {
  RegionProgress& note = object.note(region);
  if (result == spm::AcceptResult::kAccepted) note.was_incomplete = 0;
  if (result == spm::AcceptResult::kAccepted || result == spm::AcceptResult::kLoaded) {
    // Loaded by an earlier gateway, or returned after an earlier gateway retired it and before this one sent it.
    if (note.pool_state() == PoolState::kNotLoaded) mark_loaded(object, region);
    return;
  }
  if (note.pool_state() == PoolState::kLoaded) {
    mark_unloaded(object, region);
    note.set(PoolState::kNotLoaded);
  } else {  // retired meanwhile
    end_departure(object, region);
  }
  ++figures_.refused_other;
  // A record can be missing because the intake has refused another region.
  const bool is_first_time = result == spm::AcceptResult::kIncomplete && note.was_incomplete == 0;
  note.was_incomplete = result == spm::AcceptResult::kIncomplete ? 1 : 0;
  if (!is_first_time && result != spm::AcceptResult::kPoolFull && note.store_state() != StoreState::kAbsent)
    mark_faulty(object, region);
}

/// Lets the store evict the region as soon as possible.
void Loader::mark_faulty(Object& object, std::uint32_t region) {
  RegionProgress& note = object.note(region);
  if (note.is_faulty != 0) return;
  note.is_faulty = 1;
  ++faulty_regions_;
  report_warning("object " + object.info.name + ": region " + std::to_string(region) +
                 " contradicts the records in memory; it is requested again");
}

}  // namespace tactus::hrtc_service
