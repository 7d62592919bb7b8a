// The loader's half for the store: it selects the regions to request, to leave out of `have`, and to free.
#include <algorithm>
#include <tuple>

#include "hrtc_service/loader.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr double kNsPerS = 1e9;
constexpr double kSureOf = 0.9;  // of the store: some messages need more blocks for their bytes than the average

}  // namespace

/// In the order of arrival.
void Loader::take(Object& object, session::DeliveryClient::Message message, std::int64_t now_ns) {
  if (parked_.empty() && keep(object, message, now_ns)) return;
  if (parked_bytes_ + message.bytes.size() > settings_.delivery.max_credit) {  // more than was requested
    ++figures_.refused_full;
    return delivery_.refused(object.info.id, message.region);
  }
  delivery_.park(object.info.id, message.region);
  parked_bytes_ += message.bytes.size();
  parked_.push_back({&object, std::move(message)});
}

void Loader::take_parked(std::int64_t now_ns) {
  while (!parked_.empty() && keep(*parked_.front().object, parked_.front().message, now_ns)) {
    parked_bytes_ -= parked_.front().message.bytes.size();
    parked_.pop_front();
  }
}

bool Loader::keep(Object& object, const session::DeliveryClient::Message& message, std::int64_t now_ns) {
  using Status = spm::codec::CompressedCache::Put::Status;
  const auto refuse = [&] {
    delivery_.refused(object.info.id, message.region);
    return true;
  };
  if (!object.ready || message.region >= object.notes.size()) return refuse();
  const spm::ObjectIndex number{object.info.index};
  const spm::RegionId region{message.region};
  const std::span<const std::uint8_t> bytes{message.bytes};
  spm::codec::CompressedCache::Put put = store_.put(number, region, bytes);
  while (put.status == Status::kFull && free_spare())
    if (store_.blocks_free() >= put.blocks) put = store_.put(number, region, bytes);

  RegionNote& note = object.notes[message.region];
  const auto wish = object.wishes.find(message.region);
  switch (put.status) {
    case Status::kKept:
      break;
    case Status::kHere:
      if (note.kept() != Kept::kHeld) return refuse();  // being evicted; requested again afterwards
      delivery_.held(object.info.id, message.region);
      return true;
    case Status::kFull:
      if (!eviction_candidates_.empty()) return false;
      if (wish != object.wishes.end()) wish->second.blocks_needed = put.blocks;
      ++figures_.refused_full;
      return refuse();
    case Status::kIncomplete:
      ++figures_.refused_other;
      return refuse();
    case Status::kMalformed:
      ++figures_.decode_errors;
      say("object " + object.info.name + ": region " + std::to_string(message.region) + " refused: " + put.error);
      return refuse();
  }
  object.info.records_received += put.records;
  object.info.records_returned += put.returned;
  figures_.records_received += put.records;
  figures_.records_returned += put.returned;
  figures_.records_repeated += put.repeated;
  figures_.records_published += put.published;
  ++object.info.regions_received;
  ++figures_.regions_received;
  if (note.was_here) ++figures_.regions_reloaded;
  if (wish != object.wishes.end() && wish->second.since_ns != 0) {
    const double latency = static_cast<double>(now_ns - wish->second.since_ns) / kNsPerS;
    figures_.load_latency += 0.1 * (latency - figures_.load_latency);
  }
  figures_.compressed_peak = std::max(figures_.compressed_peak, store_.blocks() - store_.blocks_free());
  const std::uint32_t records = cache_.records_of(number, region);
  if (records > 0) blocks_per_record_ += 0.1 * (static_cast<double>(put.blocks) / records - blocks_per_record_);
  bytes_per_block_ += 0.1 * (static_cast<double>(message.bytes.size()) / put.whole - bytes_per_block_);
  note.set(Kept::kHeld);
  note.was_here = 1;
  object.held.push_back(message.region);
  delivery_.held(object.info.id, message.region);
  const spm::Cache::Room room = fresh_room_of(object, message.region);
  if (note.shown() == Shown::kNot && cache_.slots_free() >= room.slots && cache_.blocks_free() >= room.blocks)
    static_cast<void>(show(object, message.region));
  return true;
}

double Loader::coded_of(const Object& object, std::uint32_t region) const noexcept {
  return blocks_per_record_ * cache_.records_of(spm::ObjectIndex{object.info.index}, spm::RegionId{region});
}

/// Wants the regions that are met soonest, over all objects, as far as the store can hold them together. Otherwise
/// regions that are met late would take the memory of those that are met now.
void Loader::want(std::int64_t now_ns) {
  const double room = 0.9 * store_.blocks();
  std::stable_sort(prospects_.begin(), prospects_.end(),
                   [](const Prospect& a, const Prospect& b) { return a.doubt < b.doubt; });
  // The regions that arrive in a round trip replace those that were left out of `have` one round trip before.
  constexpr double kOnTheWay = 1.5;
  double all = 0;  // blocks
  const auto beyond = std::find_if(prospects_.begin(), prospects_.end(), [&](const Prospect& prospect) {
    const bool absent = prospect.object->notes[prospect.region].absent();
    all += (absent ? kOnTheWay : 1) * coded_of(*prospect.object, prospect.region);
    return all > room && prospect.contact_in > 0;
  });
  prospects_.erase(beyond, prospects_.end());
  std::stable_sort(prospects_.begin(), prospects_.end(),
                   [](const Prospect& a, const Prospect& b) { return a.order < b.order; });
  std::array<std::vector<session::Wanted>, kMaxObjects> wanted;  // by object index
  constexpr double kToFree = 0.01;                               // s
  const double soon = delivery_.rate() / bytes_per_block_ * kToFree;
  double absent = 0;  // blocks of its part that is not stored
  needed_ = 0;
  wanted_at_ns_ = now_ns;
  const double promised = static_cast<double>(delivery_.granted_credit(now_ns)) / (kSureOf * bytes_per_block_);
  for (const Prospect& prospect : prospects_) {
    RegionNote& note = prospect.object->notes[prospect.region];
    Wish& wish = *prospect.wish;
    note.want_at(now_ns);
    if (wish.since_ns == 0) wish.since_ns = now_ns;
    if (prospect.contact_in <= 0) note.meet_at(now_ns, settings_.idle_before_spare_ns);
    const bool going = note.kept() == Kept::kLeaving || note.kept() == Kept::kSpare;
    const double takes = coded_of(*prospect.object, prospect.region);
    // Otherwise its memory is reserved: it is evicted last, and may be shown until then.
    if (going && !note.faulty && room_to_come() - takes > promised) take_back(*prospect.object, prospect.region);
    if (!note.absent()) continue;
    absent += takes;
    if (needed_ == 0 || needed_ < soon) needed_ += std::max(static_cast<std::uint32_t>(takes), wish.blocks_needed);
    // Refused before, so it would not fit now.
    if (room_to_come() < wish.blocks_needed) continue;
    wanted[prospect.object->info.index].push_back({prospect.region, static_cast<std::uint32_t>(prospect.order * 1e6)});
  }
  // The absent regions arrive within a round trip, and as many more will be wanted until then.
  constexpr double kAhead = 2;
  reserve_ = static_cast<std::uint32_t>(std::clamp(kAhead * absent, store_.blocks() / 16.0, store_.blocks() * 0.75));
  const double coming = room_to_come();
  // A base mesh is admitted or refused whatever regions take.
  if (std::all_of(objects_.begin(), objects_.end(),
                  [](const auto& entry) { return entry.second->ready || entry.second->refused; }))
    delivery_.set_room(static_cast<std::uint64_t>(kSureOf * coming * bytes_per_block_));
  for (Object* object : active_) delivery_.want(object->info.id, std::move(wanted[object->info.index]));
}

/// Leaves out of `have` the regions that are least likely to be wanted again, until they free enough memory for the
/// reserve. First those that no tip met; then those of one visit, longest unwanted first; then by the visit before the
/// last, so that the regions of a repeated path remain although many others pass (O'Neil et al. 1993, LRU-2). A region
/// that was wanted a moment ago is left out only when there is no other and the memory is needed now.
void Loader::find_eviction_candidates() {
  const auto gives = [&](std::uint32_t blocks) { return room_to_come() >= blocks; };
  const bool enough = settings_.keep_unwanted && gives(reserve_) && gives(needed_);
  if (enough && faulty_ == 0) return;

  struct Candidate {
    bool sound, recent, was_met;
    std::int64_t visit_before_ns, wanted_ns;  // less when longer ago
    Object* object;
    std::uint32_t region;
    [[nodiscard]] auto order() const {
      return std::make_tuple(sound, recent, recent || was_met, recent ? 0 : visit_before_ns, wanted_ns);
    }
  };
  std::vector<Candidate> candidates;
  for (Object* object : active_)
    for (const std::uint32_t region : object->held) {
      const RegionNote& note = object->notes[region];
      const std::int64_t unwanted_ns = note.unwanted_ns(wanted_at_ns_);
      if (unwanted_ns == 0 && !note.faulty) continue;
      const bool recent = unwanted_ns < settings_.idle_before_spare_ns;
      candidates.push_back(
          {note.faulty == 0, recent, note.met != 0, -note.since_visit_ns(wanted_at_ns_), -unwanted_ns, object, region});
    }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.order() < b.order(); });
  for (const Candidate& candidate : candidates) {
    if (candidate.sound && settings_.keep_unwanted && gives(needed_) && gives(reserve_)) break;
    Object& object = *candidate.object;
    if (!delivery_.retire(object.info.id, candidate.region)) continue;
    store_.leave(spm::ObjectIndex{object.info.index}, spm::RegionId{candidate.region});
    object.notes[candidate.region].set(Kept::kLeaving);
    object.held.erase(std::find(object.held.begin(), object.held.end(), candidate.region));
    eviction_candidates_.push_back({&object, candidate.region});
  }
}

void Loader::take_back(Object& object, std::uint32_t region) {
  eviction_candidates_.erase(
      std::find_if(eviction_candidates_.begin(), eviction_candidates_.end(), [&](const Place& eviction_candidate) {
        return eviction_candidate.object == &object && eviction_candidate.region == region;
      }));
  store_.stay(spm::ObjectIndex{object.info.index}, spm::RegionId{region});
  object.notes[region].set(Kept::kHeld);
  object.held.push_back(region);
  delivery_.held(object.info.id, region);
}

void Loader::take_released() {
  for (Object* object : active_)
    for (const std::uint32_t region : delivery_.take_released(object->info.id))
      if (object->notes[region].kept() == Kept::kLeaving) object->notes[region].set(Kept::kSpare);
  const auto goes = [&](const Place& eviction_candidate) {
    const RegionNote& note = eviction_candidate.object->notes[eviction_candidate.region];
    return note.kept() == Kept::kSpare && (note.faulty != 0 || !settings_.keep_unwanted);
  };
  for (auto eviction_candidate = eviction_candidates_.begin(); eviction_candidate != eviction_candidates_.end();)
    eviction_candidate = goes(*eviction_candidate) ? free_now(eviction_candidate) : std::next(eviction_candidate);
}

std::deque<Loader::Place>::iterator Loader::free_now(std::deque<Place>::iterator eviction_candidate) {
  evict(*eviction_candidate->object, eviction_candidate->region);
  ++figures_.regions_evicted;
  return eviction_candidates_.erase(eviction_candidate);
}

/// A region that leaves.
void Loader::evict(Object& object, std::uint32_t region) {
  store_.release(spm::ObjectIndex{object.info.index}, spm::RegionId{region});
  RegionNote& note = object.notes[region];
  note.set(Kept::kAbsent);
  faulty_ -= note.faulty;
  note.faulty = 0;
  ++object.info.regions_released;
}

/// Frees a spare region, if possible one that is not wanted again. False when none is spare.
bool Loader::free_spare() {
  auto spare = eviction_candidates_.end();
  for (auto eviction_candidate = eviction_candidates_.begin(); eviction_candidate != eviction_candidates_.end();
       ++eviction_candidate) {
    const RegionNote& note = eviction_candidate->object->notes[eviction_candidate->region];
    if (note.kept() != Kept::kSpare) continue;
    if (spare == eviction_candidates_.end()) spare = eviction_candidate;
    if (note.unwanted_ns(wanted_at_ns_) == 0) continue;
    spare = eviction_candidate;
    break;
  }
  if (spare == eviction_candidates_.end()) return false;
  free_now(spare);
  return true;
}

}  // namespace tactus::hrtc_service
