// The store of the loader: selects the regions to request, to retire and to evict.
#include <algorithm>
#include <tuple>

#include "hrtc_service/loader.hpp"
#include "session/units.hpp"

namespace tactus::hrtc_service {
namespace {

// Share of the store that estimates may fill. Some messages need more blocks for each byte than the average.
constexpr double kUsableShare = 0.9;

}  // namespace

/// Stores or refuses the region of a message, in the order of arrival. While the store has no memory for the region,
/// the message waits.
void Loader::on_region(Object& object, session::DeliveryClient::Message message, std::int64_t now_ns) {
  if (waiting_messages_.empty() && store_or_refuse(object, message, now_ns)) return;
  if (waiting_bytes_ + message.bytes.size() > settings_.delivery.max_credit) {  // hosts sent more than their credit
    ++figures_.refused_full;
    return delivery_.answer_refused(object.info.id, message.region);
  }
  delivery_.postpone_answer(object.info.id, message.region);
  waiting_bytes_ += message.bytes.size();
  waiting_messages_.push_back({&object, std::move(message)});
}

void Loader::store_waiting(std::int64_t now_ns) {
  while (!waiting_messages_.empty() &&
         store_or_refuse(*waiting_messages_.front().object, waiting_messages_.front().message, now_ns)) {
    waiting_bytes_ -= waiting_messages_.front().message.bytes.size();
    waiting_messages_.pop_front();
  }
}

bool Loader::store_or_refuse(Object& object, const session::DeliveryClient::Message& message, std::int64_t now_ns) {
  using Status = spm::codec::CompressedCache::PutResult::Status;
  const auto refuse = [&] {
    delivery_.answer_refused(object.info.id, message.region);
    return true;
  };
  if (!object.ready || object.find_page(message.region) == nullptr) return refuse();
  const spm::ObjectIndex number{object.info.index};
  const spm::RegionId region{message.region};
  const std::span<const std::uint8_t> bytes{message.bytes};
  spm::codec::CompressedCache::PutResult put = store_.put(number, region, bytes);
  while (put.status == Status::kFull && evict_one())
    if (store_.blocks_free() >= put.blocks) put = store_.put(number, region, bytes);

  RegionProgress& note = object.note(message.region);
  const auto wanted_region = object.wanted_regions.find(message.region);
  switch (put.status) {
    case Status::kStored:
      break;
    case Status::kAlreadyHeld:
      if (note.store_state() != StoreState::kHeld) return refuse();  // retired; requested again after its eviction
      delivery_.answer_stored(object.info.id, message.region);
      return true;
    case Status::kFull:
      if (!eviction_candidates_.empty()) return false;
      if (wanted_region != object.wanted_regions.end()) wanted_region->second.blocks_needed = put.blocks;
      ++figures_.refused_full;
      return refuse();
    case Status::kIncomplete:
      ++figures_.refused_other;
      return refuse();
    case Status::kMalformed:
      ++figures_.decode_errors;
      report_warning("object " + object.info.name + ": region " + std::to_string(message.region) +
                     " refused: " + put.error);
      return refuse();
  }
  object.info.records_received += put.records;
  object.info.records_received_again += put.returned;
  figures_.records_received += put.records;
  figures_.records_received_again += put.returned;
  figures_.records_repeated += put.repeated;
  figures_.records_repeated_unretired += put.repeated_unretired;
  ++object.info.regions_received;
  ++figures_.regions_received;
  if (note.was_stored) ++figures_.regions_reloaded;
  if (wanted_region != object.wanted_regions.end() && wanted_region->second.since_ns != 0) {
    const double latency = static_cast<double>(now_ns - wanted_region->second.since_ns) / kNsPerS;
    figures_.load_latency += 0.1 * (latency - figures_.load_latency);
  }
  figures_.compressed_peak = std::max(figures_.compressed_peak, store_.blocks() - store_.blocks_free());
  const std::uint32_t records = object.list(message.region).records;
  if (records > 0) blocks_per_record_ += 0.1 * (static_cast<double>(put.blocks) / records - blocks_per_record_);
  bytes_per_block_ += 0.1 * (static_cast<double>(message.bytes.size()) / put.blocks_if_empty - bytes_per_block_);
  note.set(StoreState::kHeld);
  note.was_stored = 1;
  object.held.push_back(message.region);
  delivery_.answer_stored(object.info.id, message.region);
  if (note.pool_state() == PoolState::kLoaded) store_.mark_loaded(number, region);
  const spm::Cache::Space space = space_to_load(object, message.region);
  if (note.pool_state() == PoolState::kNotLoaded && intake_.free_space().slots >= space.slots &&
      intake_.free_space().blocks >= space.blocks)
    static_cast<void>(load(object, message.region));
  return true;
}

double Loader::block_estimate(const Object& object, std::uint32_t region) const noexcept {
  return blocks_per_record_ * object.list(region).records;
}

/// Requests the most probable predicted regions of all objects that fit into the store together. Without this limit,
/// later contacts would take the memory of contacts that are due now.
void Loader::request_wanted(std::int64_t now_ns) {
  const double usable_blocks = kUsableShare * store_.blocks();
  std::stable_sort(predicted_contacts_.begin(), predicted_contacts_.end(),
                   [](const PredictedContact& a, const PredictedContact& b) { return a.uncertainty < b.uncertainty; });
  // An absent region counts more, because another region must be evicted for it. The blocks of that other region become
  // free only one round trip after it is retired.
  constexpr double kInFlightFactor = 1.5;
  double blocks = 0;
  const auto first_excess =
      std::find_if(predicted_contacts_.begin(), predicted_contacts_.end(), [&](const PredictedContact& contact) {
        const bool absent = contact.object->note(contact.region).is_absent();
        blocks += (absent ? kInFlightFactor : 1) * block_estimate(*contact.object, contact.region);
        return blocks > usable_blocks && contact.time_to_contact > 0;
      });
  predicted_contacts_.erase(first_excess, predicted_contacts_.end());
  std::stable_sort(
      predicted_contacts_.begin(), predicted_contacts_.end(),
      [](const PredictedContact& a, const PredictedContact& b) { return a.request_order < b.request_order; });
  std::array<std::vector<session::Wanted>, kMaxObjects> wanted;  // by object index
  constexpr double kEvictionTime = 0.01;                         // s
  const double blocks_to_free_now = delivery_.rate() / bytes_per_block_ * kEvictionTime;
  double absent_blocks = 0;
  blocks_needed_ = 0;
  last_tick_ns_ = now_ns;
  const double credit_blocks =
      static_cast<double>(delivery_.granted_credit(now_ns)) / (kUsableShare * bytes_per_block_);
  for (const PredictedContact& contact : predicted_contacts_) {
    RegionProgress& note = contact.object->note(contact.region);
    WantedRegion& wanted_region = *contact.wanted;
    note.mark_wanted(now_ns);
    if (wanted_region.since_ns == 0) wanted_region.since_ns = now_ns;
    if (contact.time_to_contact <= 0) note.mark_contact(now_ns, settings_.recently_wanted_ns);
    const bool retired = note.store_state() == StoreState::kRetired || note.store_state() == StoreState::kEvictable;
    const double region_blocks = block_estimate(*contact.object, contact.region);
    // A retired region that is wanted again is reinstated, unless hosts have credit for its blocks. In this case it
    // remains retired, is evicted last, and can be loaded until then.
    if (retired && !note.is_faulty && blocks_after_eviction() - region_blocks > credit_blocks)
      cancel_eviction(*contact.object, contact.region);
    if (!note.is_absent()) continue;
    absent_blocks += region_blocks;
    if (blocks_needed_ == 0 || blocks_needed_ < blocks_to_free_now)
      blocks_needed_ += std::max(static_cast<std::uint32_t>(region_blocks), wanted_region.blocks_needed);
    // The full store refused the region, and would refuse it again.
    if (blocks_after_eviction() < wanted_region.blocks_needed) continue;
    wanted[contact.object->info.index].push_back(
        {contact.region, static_cast<std::uint32_t>(contact.request_order * 1e6)});
  }
  // The absent regions arrive within a round trip. In that time as many others become wanted.
  constexpr double kReserveFactor = 2;
  blocks_reserve_ = static_cast<std::uint32_t>(
      std::clamp(kReserveFactor * absent_blocks, store_.blocks() / 16.0, store_.blocks() * 0.75));
  delivery_.limit_credit(static_cast<std::uint64_t>(kUsableShare * blocks_after_eviction() * bytes_per_block_) +
                         base_credit() + page_credit());
  for (Object* object : active_) {
    std::vector<session::Wanted>& all = wanted[object->info.index];
    all.insert(all.end(), object->wanted_pages.begin(), object->wanted_pages.end());
    delivery_.set_wanted(object->info.id, std::move(all));
  }
  for (const auto& [id, object] : objects_)
    if (!object->ready && !object->refused) delivery_.set_wanted(id, object->wanted_pages);
}

/// Retires all faulty regions, and further regions until their eviction frees `blocks_needed_` and `blocks_reserve_`:
///  1. regions that no probe touched, longest unwanted first;
///  2. regions with one visit, longest unwanted first;
///  3. regions with more visits, in the order of their second-last visit, the oldest first. So the regions of a
///     repeated path remain although many others are visited (O'Neil et al. 1993, LRU-2);
///  4. recently wanted regions, longest unwanted first.
void Loader::find_eviction_candidates() {
  const auto has_enough_blocks = [&] { return blocks_after_eviction() >= std::max(blocks_reserve_, blocks_needed_); };
  if (has_enough_blocks() && faulty_regions_ == 0) return;

  struct Candidate {
    bool is_sound, is_recent, was_touched;
    std::int64_t previous_visit_ns, wanted_ns;  // time since the event, negated
    Object* object;
    std::uint32_t region;
    [[nodiscard]] auto order() const {
      return std::make_tuple(is_sound, is_recent, is_recent || was_touched, is_recent ? 0 : previous_visit_ns,
                             wanted_ns);
    }
  };
  std::vector<Candidate> candidates;
  for (Object* object : active_)
    for (const std::uint32_t region : object->held) {
      const RegionProgress& note = object->note(region);
      const std::int64_t unwanted_ns = note.unwanted_ns(last_tick_ns_);
      if (unwanted_ns == 0 && !note.is_faulty) continue;
      const bool is_recent = unwanted_ns < settings_.recently_wanted_ns;
      candidates.push_back({note.is_faulty == 0, is_recent, note.last_contact != 0,
                            -note.since_previous_visit_ns(last_tick_ns_), -unwanted_ns, object, region});
    }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.order() < b.order(); });
  for (const Candidate& candidate : candidates) {
    if (candidate.is_sound && has_enough_blocks()) break;
    Object& object = *candidate.object;
    if (!delivery_.retire(object.info.id, candidate.region)) continue;
    store_.retire(spm::ObjectIndex{object.info.index}, spm::RegionId{candidate.region});
    object.note(candidate.region).set(StoreState::kRetired);
    object.held.erase(std::find(object.held.begin(), object.held.end(), candidate.region));
    eviction_candidates_.push_back({&object, candidate.region});
  }
}

void Loader::cancel_eviction(Object& object, std::uint32_t region) {
  eviction_candidates_.erase(std::find_if(
      eviction_candidates_.begin(), eviction_candidates_.end(),
      [&](const RegionRef& candidate) { return candidate.object == &object && candidate.region == region; }));
  store_.reinstate(spm::ObjectIndex{object.info.index}, spm::RegionId{region});
  object.note(region).set(StoreState::kHeld);
  object.held.push_back(region);
  delivery_.answer_stored(object.info.id, region);
}

void Loader::collect_released() {
  for (Object* object : active_)
    for (const std::uint32_t region : delivery_.take_released(object->info.id))
      if (object->note(region).store_state() == StoreState::kRetired) object->note(region).set(StoreState::kEvictable);
  const auto must_free = [&](const RegionRef& candidate) {
    const RegionProgress& note = candidate.object->note(candidate.region);
    return note.store_state() == StoreState::kEvictable && note.is_faulty != 0;
  };
  for (auto candidate = eviction_candidates_.begin(); candidate != eviction_candidates_.end();)
    candidate = must_free(*candidate) ? evict_candidate(candidate) : std::next(candidate);
}

std::deque<Loader::RegionRef>::iterator Loader::evict_candidate(std::deque<RegionRef>::iterator candidate) {
  evict(*candidate->object, candidate->region);
  ++figures_.regions_evicted;
  return eviction_candidates_.erase(candidate);
}

/// Frees a retired region in the store.
void Loader::evict(Object& object, std::uint32_t region) {
  RegionProgress& note = object.note(region);
  const spm::ObjectIndex number{object.info.index};
  if (note.pool_state() == PoolState::kLoaded) store_.mark_unloaded(number, spm::RegionId{region});
  store_.evict(number, spm::RegionId{region});
  note.set(StoreState::kAbsent);
  faulty_regions_ -= note.is_faulty;
  note.is_faulty = note.was_incomplete = 0;
  ++object.info.regions_released;
}

/// Evicts an evictable region, preferably an unwanted one. Returns false if no region is evictable.
bool Loader::evict_one() {
  auto chosen = eviction_candidates_.end();
  for (auto candidate = eviction_candidates_.begin(); candidate != eviction_candidates_.end(); ++candidate) {
    const RegionProgress& note = candidate->object->note(candidate->region);
    if (note.store_state() != StoreState::kEvictable) continue;
    if (chosen == eviction_candidates_.end()) chosen = candidate;
    if (note.unwanted_ns(last_tick_ns_) == 0) continue;
    chosen = candidate;
    break;
  }
  if (chosen == eviction_candidates_.end()) return false;
  evict_candidate(chosen);
  return true;
}

}  // namespace tactus::hrtc_service
