// The loader's half for the pool: it decodes the regions that are met next, and frees memory for them.
#include <algorithm>

#include "hrtc_service/loader.hpp"

namespace tactus::hrtc_service {
namespace {

/// The memory reserved for contacts that were not predicted.
spm::Cache::Room reserve_of(const spm::PoolSettings& pool) noexcept { return {pool.slots / 16, pool.list_blocks / 16}; }

}  // namespace

double Loader::slots_of(const Object& object, std::uint32_t region) const noexcept {
  return cache_.records_of(spm::ObjectIndex{object.info.index}, spm::RegionId{region}) *
         (static_cast<double>(object.summary.parts) / std::max(object.summary.records, 1u));
}

spm::Cache::Room Loader::fresh_room_of(const Object& object, std::uint32_t region) const noexcept {
  const std::uint32_t records = cache_.records_of(spm::ObjectIndex{object.info.index}, spm::RegionId{region});
  return {static_cast<std::uint32_t>(fresh_share_ * slots_of(object, region)), spm::ListBlock::blocks_for(records)};
}

/// Decodes the regions that are met soonest. Those that are met within kSoon replace regions that are met later; the
/// others use free memory only.
void Loader::show_due() {
  constexpr double kSoon = 0.03;  // s
  constexpr int kMaxBefore = 16;  // regions that are not met soon, in a tick
  for (const Place& place : due_) place.object->notes[place.region].due = 0;
  due_.clear();
  std::stable_sort(prospects_.begin(), prospects_.end(),
                   [](const Prospect& a, const Prospect& b) { return a.contact_in < b.contact_in; });
  const double room = 0.9 * (pool_.settings.slots - base_slots_);
  const spm::Cache::Room reserve = reserve_of(pool_.settings);
  room_needed_ = {};
  bool full = false;
  int before = 0;
  double all = 0;  // slots
  for (const Prospect& prospect : prospects_) {
    Object& object = *prospect.object;
    RegionNote& note = object.notes[prospect.region];
    const spm::Cache::Room takes = fresh_room_of(object, prospect.region);
    all += takes.slots;
    if (all > room && prospect.contact_in > 0) break;
    note.due = 1;
    due_.push_back({&object, prospect.region});
    if (note.shown() != Shown::kNot || note.kept() == Kept::kAbsent || note.faulty != 0) continue;
    if (prospect.contact_in > kSoon) {
      const bool spare =
          cache_.slots_free() >= takes.slots + reserve.slots && cache_.blocks_free() >= takes.blocks + reserve.blocks;
      if (spare && !full && before++ < kMaxBefore) static_cast<void>(show(object, prospect.region));
      continue;
    }
    const spm::Cache::Room lacks = full ? takes : show(object, prospect.region);
    full = lacks.slots > 0;
    room_needed_.slots += lacks.slots;
    room_needed_.blocks += lacks.blocks;
  }
}

spm::Cache::Room Loader::show(Object& object, std::uint32_t region) {
  const spm::ObjectIndex number{object.info.index};
  RegionNote& note = object.notes[region];
  const spm::RegionData& data = store_.get(number, spm::RegionId{region}, cache_);
  spm::RegionList list;
  const spm::AcceptResult result = cache_.accept(number, data, list);
  if (result == spm::AcceptResult::kPoolFull)
    return {std::max(static_cast<std::uint32_t>(data.parts.size()), 1u),
            spm::ListBlock::blocks_for(cache_.records_of(number, spm::RegionId{region}))};
  if (result != spm::AcceptResult::kAccepted) {
    note.faulty = 1;
    ++faulty_;
    ++figures_.refused_other;
    say("object " + object.info.name + ": region " + std::to_string(region) + " contradicts what is here; asked anew");
    return {};
  }
  const double whole = slots_of(object, region);
  if (whole > 0) fresh_share_ += 0.1 * (static_cast<double>(data.parts.size()) / whole - fresh_share_);
  note.set(Shown::kShown);
  object.shown.push_back(region);
  figures_.slots_peak = std::max(figures_.slots_peak, cache_.slots_used());
  waiting_.push_back({Arrival::Kind::kRegion, &object.touch, spm::RegionId{region}, list});
  return {};
}

/// Requests that regions are coarsened, longest unwanted first, until the due regions and a reserve fit.
void Loader::coarsen() {
  constexpr std::size_t kAtOnce = 16;
  const spm::Cache::Room reserve = reserve_of(pool_.settings);
  const spm::Cache::Room ready{std::max(room_needed_.slots, reserve.slots),
                               std::max(room_needed_.blocks, reserve.blocks)};
  spm::Cache::Room coming{cache_.slots_free(), cache_.blocks_free()};
  for (const Departing& departing : departing_) {
    coming.slots += departing.room.slots;
    coming.blocks += departing.room.blocks;
  }
  const auto enough = [&] {
    return settings_.keep_unwanted && coming.slots >= ready.slots && coming.blocks >= ready.blocks;
  };
  if (enough() || departing_.size() >= kAtOnce) return;
  struct Candidate {
    std::int64_t unwanted_ns;
    Object* object;
    std::uint32_t region;
  };
  std::vector<Candidate> candidates;
  for (Object* object : active_)
    for (const std::uint32_t region : object->shown) {
      const RegionNote& note = object->notes[region];
      const bool wanted = note.due != 0 || (!settings_.keep_unwanted && note.unwanted_ns(wanted_at_ns_) == 0);
      if (!wanted) candidates.push_back({note.unwanted_ns(wanted_at_ns_), object, region});
    }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.unwanted_ns > b.unwanted_ns; });
  for (const Candidate& candidate : candidates) {
    if (enough() || departing_.size() >= kAtOnce) return;
    Object& object = *candidate.object;
    const spm::RegionId region{candidate.region};
    object.notes[candidate.region].set(Shown::kDeparting);
    object.shown.erase(std::find(object.shown.begin(), object.shown.end(), candidate.region));
    const spm::Cache::Room room = cache_.room_of(spm::ObjectIndex{object.info.index}, region);
    departing_.push_back({&object, candidate.region, room});
    coming.slots += room.slots;
    coming.blocks += room.blocks;
    waiting_.push_back({Arrival::Kind::kRetire, &object.touch, region, {}});
  }
}

void Loader::take_departures() {
  Departure departure;
  while (departures_.pop(departure)) {
    Object& object = *by_index_[departure.object];
    if (departure.is_object()) {
      free_withdrawn(object);
      continue;
    }
    const std::uint32_t region = spm::index(departure.region);
    cache_.release(spm::ObjectIndex{object.info.index}, departure.region);
    object.notes[region].set(Shown::kNot);
    departing_.erase(std::find_if(departing_.begin(), departing_.end(), [&](const Departing& departing) {
      return departing.object == &object && departing.region == region;
    }));
    ++figures_.regions_coarsened;
  }
}

}  // namespace tactus::hrtc_service
