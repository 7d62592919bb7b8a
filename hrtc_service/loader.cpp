#include "hrtc_service/loader.hpp"

#include <malloc.h>

#include <algorithm>
#include <cstdio>
#include <tuple>

#include "spm/codec/base_codec.hpp"
#include "spm/codec/region_codec.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr double kNsPerS = 1e9;

spm::fcl::WorldBox world_box(const spm::CellBox& box, const Placement& placement) {
  spm::fcl::WorldBox world{Vec3d::Constant(1e300), Vec3d::Constant(-1e300)};
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3d at =
        placement.to_world({(corner & 1) != 0 ? box.high[0] : box.low[0], (corner & 2) != 0 ? box.high[1] : box.low[1],
                            (corner & 4) != 0 ? box.high[2] : box.low[2]});
    world.low = world.low.cwiseMin(at);
    world.high = world.high.cwiseMax(at);
  }
  return world;
}

Vec3d wide(const std::array<float, 3>& p) { return {p[0], p[1], p[2]}; }

}  // namespace

Loader::Loader(spm::Pool& pool, spm::NodePool& nodes, const session::Origin& self, const LoaderSettings& settings,
               ArrivalRing& arrivals, DepartureRing& departures)
    : pool_{pool},
      nodes_{nodes},
      settings_{settings},
      arrivals_{arrivals},
      departures_{departures},
      cache_{pool},
      delivery_{self, settings.delivery} {}

Loader::~Loader() = default;

void Loader::on_catalogue(const session::CatalogueEntry& entry) {
  delivery_.offer(entry);
  if (entry.withdrawn) return;
  const auto known = objects_.find(entry.object_id);
  if (known != objects_.end()) {
    if (known->second->summary.digest != entry.summary.digest)
      say("object " + entry.object + ": host " + entry.host + " offers a different model under the same name; ignored");
    return;
  }
  if (objects_.size() == kMaxObjects) {
    say("object " + entry.object + ": ignored, at most " + std::to_string(kMaxObjects) + " objects in one HRTC");
    return;
  }
  auto object = std::make_unique<Object>();
  object->info.name = entry.object;
  object->info.id = entry.object_id;
  object->info.digest = entry.summary.digest;
  object->info.scale = entry.scale;
  object->entry = entry;
  object->summary = entry.summary;
  Object& added = *object;
  objects_[entry.object_id] = std::move(object);
  if (!take_directory(added)) return;
  delivery_.open(entry.object_id, entry.summary.digest);
  say("object " + entry.object + " found at host " + entry.host + ": " + std::to_string(entry.summary.faces) +
      " faces, " + std::to_string(entry.summary.regions) + " regions");
}

/// False when it does not fit.
bool Loader::take_directory(Object& object) {
  const std::uint64_t takes = spm::directory_bytes(object.summary, pool_.settings);
  const std::uint64_t left = settings_.directory_bytes - directories_;
  if (takes <= left) {
    directories_ += takes;
    return true;
  }
  object.refused = true;
  ++figures_.objects_refused;
  const auto mib = [](std::uint64_t bytes) { return static_cast<double>(bytes) / (1 << 20); };
  char sizes[128];
  std::snprintf(sizes, sizeof sizes, "takes %.1f MiB, %.1f of %.1f MiB are left", mib(takes), mib(left),
                mib(settings_.directory_bytes));
  say("object " + object.info.name + ": refused, its directory of " + std::to_string(object.summary.regions) +
      " regions " + sizes + "; raise --memory");
  return false;
}

void Loader::on_host_seen(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns) {
  delivery_.host_seen(host, incarnation, now_ns);
}

void Loader::on_host_gone(std::uint64_t host) { delivery_.host_gone(host); }

void Loader::on_chunk(const session::BulkChunk& chunk, std::int64_t now_ns) {
  auto message = delivery_.on_chunk(chunk, now_ns);
  if (!message) return;
  const auto found = objects_.find(message->object_id);
  if (found == objects_.end()) return;
  if (message->kind == session::BulkKind::kBase) {
    take_base(*found->second, message->bytes);
    message.reset();
    malloc_trim(0);  // what a base mesh comes and is decoded in is as large as what stays of it
  } else {
    unplaced_.push_back({found->second.get(), std::move(*message)});
    if (unplaced_.size() == 1) take_messages(now_ns);
  }
  hand_over();
}

void Loader::take_messages(std::int64_t now_ns) {
  while (!unplaced_.empty() && take_region(*unplaced_.front().object, unplaced_.front().message, now_ns))
    unplaced_.pop_front();
}

void Loader::take_base(Object& object, const std::vector<std::uint8_t>& bytes) {
  auto decoded = spm::codec::decode_base(spm::Span<const std::uint8_t>{bytes});
  if (!decoded || decoded->mesh.summary.digest != object.info.digest ||
      decoded->mesh.summary.regions != object.summary.regions ||
      decoded->mesh.summary.records != object.summary.records) {
    ++figures_.decode_errors;
    say("object " + object.info.name + ": base mesh refused: " + (decoded ? "another model's" : decoded.error().text));
    delivery_.base_refused(object.info.id);
    return;
  }
  if (object.ready) return delivery_.base_held(object.info.id);
  const spm::BaseMesh& base = decoded->mesh;
  const std::uint32_t free_before = cache_.slots_free();
  const std::uint32_t nodes_free = pool_.settings.tree_nodes - base_nodes_;
  const std::uint32_t nodes = spm::tree_nodes_over(base.faces, object.summary.faces);
  spm::Cache::Admitted admitted;
  if (nodes + spm::AbTree::kMaxHeight <= nodes_free) admitted = cache_.admit(base);
  if (!admitted.fits) {
    if (!object.refused) {
      ++figures_.objects_refused;
      directories_ -= spm::directory_bytes(object.summary, pool_.settings);
      say("object " + object.info.name + ": refused, its base mesh takes " +
          std::to_string(spm::Cache::slots_for_base(base)) + " slots and " + std::to_string(nodes) +
          " tree nodes, the pool has " + std::to_string(free_before) + " and " + std::to_string(nodes_free) +
          " free; raise --memory or --pool");
    }
    object.refused = true;
    return delivery_.base_held(object.info.id);  // asking again would change nothing
  }
  base_slots_ += free_before - cache_.slots_free();
  base_nodes_ += nodes;
  object.summary = base.summary;
  object.tables = std::move(decoded->tables);
  object.info.index = spm::index(admitted.object);
  object.notes.resize(base.regions.size());
  std::uint32_t largest = 0;
  for (const spm::Region& region : base.regions) largest = std::max(largest, region.part_count);
  if (largest > pool_.settings.slots - base_slots_)
    say("object " + object.info.name + ": stays coarse in places, for its largest region takes " +
        std::to_string(largest) + " slots, the pool has " + std::to_string(pool_.settings.slots - base_slots_) +
        " beside base meshes; raise --memory or --pool");
  TouchObject& touch = object.touch;
  touch.index = object.info.index;
  touch.id = object.info.id;
  touch.placement = Placement{object.entry.pose, object.entry.scale};
  touch.material = object.entry.material;
  touch.bounds = {wide(object.summary.bounds_min), wide(object.summary.bounds_max)};
  touch.deviation = object.summary.deviation;
  touch.forest =
      std::make_unique<spm::Forest>(pool_, nodes_, touch.index, object.summary,
                                    spm::RegionGrid{object.summary.grid, base.regions}, std::move(admitted.base));
  const double scale = object.entry.scale;
  object.predictors.assign(kMaxProbes, spm::Predictor{object.grid(),
                                                      {settings_.radius / scale, settings_.margin / scale,
                                                       settings_.least_speed / scale, settings_.strategy}});
  broad_phase_.put(touch.index, world_box(touch.bounds, touch.placement));
  by_index_.push_back(&object);
  object.ready = true;
  waiting_.push_back({Arrival::Kind::kObject, &touch, {}, {}});
  delivery_.base_held(object.info.id);
}

bool Loader::take_region(Object& object, const session::DeliveryClient::Message& message, std::int64_t now_ns) {
  const auto refuse = [&] {
    delivery_.refused(object.info.id, message.region);
    return true;
  };
  if (!object.ready || message.region >= object.notes.size()) return refuse();
  const auto data =
      spm::codec::decode_region(spm::Span<const std::uint8_t>{message.bytes}, object.summary, object.tables);
  if (!data || spm::index(data->region) != message.region) {
    ++figures_.decode_errors;
    say("object " + object.info.name + ": region " + std::to_string(message.region) +
        " refused: " + (data ? "names another region" : data.error().text));
    return refuse();
  }
  RegionNote& note = object.notes[message.region];
  const auto wish = object.wishes.find(message.region);
  spm::RegionList list;
  const std::uint64_t returned_before = cache_.counters().records_returned;
  const std::uint64_t repeated_before = cache_.counters().records_repeated;
  const spm::AcceptResult result = cache_.accept(spm::ObjectIndex{object.info.index}, *data, list);
  switch (result) {
    case spm::AcceptResult::kAccepted:
      break;
    case spm::AcceptResult::kPoolFull:
      if (wish != object.wishes.end()) wish->second.room_needed = static_cast<std::uint32_t>(data->parts.size());
      needed_.slots = std::max(needed_.slots, static_cast<std::uint32_t>(data->parts.size()));
      needed_.blocks = std::max(needed_.blocks, blocks_of(object, message.region));
      find_leavers();
      let_go();
      if (departing_ > 0) return false;
      ++figures_.refused_full;
      return refuse();
    case spm::AcceptResult::kHeld:
      if (note.state() != RegionState::kHeld) return refuse();  // on its way out; asked for again once it is gone
      delivery_.held(object.info.id, message.region);
      return true;
    case spm::AcceptResult::kIncomplete:
    case spm::AcceptResult::kMalformed:
      ++figures_.refused_other;
      return refuse();
  }
  object.info.records_received += data->offsets.size();
  object.info.records_returned += cache_.counters().records_returned - returned_before;
  object.info.records_returned += cache_.counters().records_repeated - repeated_before;
  ++object.info.regions_received;
  ++figures_.regions_received;
  if (note.was_here) ++figures_.regions_reloaded;
  if (wish != object.wishes.end() && wish->second.since_ns != 0) {
    const double latency = static_cast<double>(now_ns - wish->second.since_ns) / kNsPerS;
    figures_.load_latency += 0.1 * (latency - figures_.load_latency);
  }
  const double parts = slots_of(object, message.region);
  const auto fresh = static_cast<double>(data->parts.size());
  if (parts > 0) fresh_share_ += 0.1 * (fresh / parts - fresh_share_);
  if (fresh > 0) slot_bytes_ += 0.1 * (static_cast<double>(message.bytes.size()) / fresh - slot_bytes_);
  note.set(RegionState::kHeld);
  note.was_here = 1;
  object.held.push_back(message.region);
  figures_.slots_peak = std::max(figures_.slots_peak, cache_.slots_used());
  delivery_.held(object.info.id, message.region);
  waiting_.push_back({Arrival::Kind::kRegion, &object.touch, data->region, list});
  return true;
}

void Loader::predict(Object& object, const std::array<ProbeSight, kMaxProbes>& sights) {
  const Placement& placement = object.touch.placement;
  // A demand waits for the next one due, its answer for the next tick and cycle.
  constexpr double kTurnaround = 0.015;  // s
  const double round_trip = static_cast<double>(delivery_.round_trip_ns()) / kNsPerS;
  const double lead = std::clamp(1.25 * round_trip + kTurnaround, settings_.least_lead, settings_.most_lead);
  struct Contact {
    double in, until;  // s
    double doubt;
  };
  std::map<std::uint32_t, Contact> contacts;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const ProbeSight& sight = sights[i];
    if (!sight.active) continue;
    spm::Predictor& predictor = object.predictors[i];
    predictor.observe(static_cast<double>(sight.time_ns) / kNsPerS, placement.to_model(sight.device), sight.in_contact);
    spm::Predictor::Answer answer;
    predictor.predict(lead, answer);
    if (sight
            .in_contact)  // the proxy lags behind a device that is pressed in, and must stand on the finest surface too
      object.grid().for_each_meeting(placement.to_model(sight.proxy),
                                     (settings_.radius + settings_.margin) / placement.scale(),
                                     [&](spm::RegionId region, double) {
                                       contacts[spm::index(region)] = {0, lead, 0};
                                     });
    for (std::uint32_t k = 0; k < answer.count; ++k) {
      const spm::PredictedRegion& met = answer.regions[k];
      const Contact contact{met.contact_in, met.contact_until, met.doubt};
      const auto [at, fresh] = contacts.try_emplace(spm::index(met.region), contact);
      if (fresh) continue;
      at->second.in = std::min(at->second.in, contact.in);
      at->second.until = std::max(at->second.until, contact.until);
      at->second.doubt = std::min(at->second.doubt, contact.doubt);
    }
  }
  for (auto wish = object.wishes.begin(); wish != object.wishes.end();)
    wish = contacts.count(wish->first) == 0 ? object.wishes.erase(wish) : std::next(wish);
  for (const auto& [region, contact] : contacts) {
    // What cannot be here before the tip has left it goes last.
    constexpr double kTooLate = 1e3;
    const bool in_time = object.notes[region].state() != RegionState::kAbsent || contact.until >= round_trip;
    prospects_.push_back({contact.doubt + (in_time ? 0 : kTooLate), in_time ? contact.in : lead + contact.in,
                          contact.in, &object, region, &object.wishes[region]});
  }
}

double Loader::slots_of(const Object& object, std::uint32_t region) const noexcept {
  return cache_.records_of(spm::ObjectIndex{object.info.index}, spm::RegionId{region}) *
         (static_cast<double>(object.summary.parts) / std::max(object.summary.records, 1u));
}

std::uint32_t Loader::blocks_of(const Object& object, std::uint32_t region) const noexcept {
  return spm::ListBlock::blocks_for(cache_.records_of(spm::ObjectIndex{object.info.index}, spm::RegionId{region}));
}

/// Wants what is met soonest, over all objects, as far as the pool can hold it together: else what is met late would
/// keep the room from what is met now.
void Loader::want(std::int64_t now_ns) {
  const double room = 0.9 * (pool_.settings.slots - base_slots_);
  const auto slots_for = [&](const Prospect& prospect) {
    return fresh_share_ * slots_of(*prospect.object, prospect.region);
  };
  std::stable_sort(prospects_.begin(), prospects_.end(),
                   [](const Prospect& a, const Prospect& b) { return a.doubt < b.doubt; });
  // What comes in a round trip takes the place of what was left out of `have` one round trip before.
  constexpr double kOnTheWay = 1.5;
  double all = 0;  // slots
  const auto beyond = std::find_if(prospects_.begin(), prospects_.end(), [&](const Prospect& prospect) {
    const bool absent = prospect.object->notes[prospect.region].state() == RegionState::kAbsent;
    all += (absent ? kOnTheWay : 1) * slots_for(prospect);
    return all > room && prospect.contact_in > 0;
  });
  prospects_.erase(beyond, prospects_.end());
  std::stable_sort(prospects_.begin(), prospects_.end(),
                   [](const Prospect& a, const Prospect& b) { return a.order < b.order; });
  std::vector<std::vector<session::Wanted>> wanted(by_index_.size());
  constexpr double kToCoarsen = 0.01;  // s
  const double soon = delivery_.rate() / slot_bytes_ * kToCoarsen;
  double absent = 0, absent_blocks = 0;  // slots and blocks of what of it is not held
  needed_ = {};
  wanted_at_ns_ = now_ns;
  for (const Prospect& prospect : prospects_) {
    RegionNote& note = prospect.object->notes[prospect.region];
    Wish& wish = *prospect.wish;
    const double share = slots_for(prospect);
    note.want_at(now_ns);
    if (wish.since_ns == 0) wish.since_ns = now_ns;
    if (prospect.contact_in <= 0) note.meet_at(now_ns, settings_.idle_before_spare_ns);
    if (note.state() == RegionState::kLeaving || note.state() == RegionState::kSpare)
      take_back(*prospect.object, prospect.region);
    if (note.state() != RegionState::kAbsent) continue;
    const std::uint32_t blocks = blocks_of(*prospect.object, prospect.region);
    absent += share;
    absent_blocks += blocks;
    if (needed_.slots == 0 || needed_.slots < soon) {
      needed_.slots += std::max(static_cast<std::uint32_t>(share), wish.room_needed);
      needed_.blocks += blocks;
    }
    // Refused before: it would only be sent in vain.
    if (cache_.slots_free() + leaving_.slots < wish.room_needed) continue;
    wanted[prospect.object->info.index].push_back({prospect.region, static_cast<std::uint32_t>(prospect.order * 1e6)});
  }
  const auto reserve = [](double of, std::uint32_t limit) {
    return static_cast<std::uint32_t>(std::clamp(1.1 * of, limit / 16.0, limit * 0.75));
  };
  reserve_ = {reserve(absent, pool_.settings.slots), reserve(absent_blocks, pool_.settings.list_blocks)};
  double coming = cache_.slots_free() + leaving_.slots;
  if (absent_blocks > 0) coming = std::min(coming, (cache_.blocks_free() + leaving_.blocks) * absent / absent_blocks);
  // A base mesh is admitted or refused whatever regions take.
  if (std::all_of(objects_.begin(), objects_.end(),
                  [](const auto& entry) { return entry.second->ready || entry.second->refused; }))
    delivery_.set_room(static_cast<std::uint64_t>(0.9 * coming * slot_bytes_));
  for (Object* object : by_index_) delivery_.want(object->info.id, std::move(wanted[object->info.index]));
}

/// Leaves out of `have` what is least likely to be wanted again, until it gives room for the reserve. First what was
/// fetched in vain; then what was visited once, longest unwanted first; then by the visit before the last, so that a
/// tip that goes round and round keeps its round however much else passes by (O'Neil et al. 1993, LRU-2). What was
/// wanted a moment ago goes only when nothing else is left and the room is needed now.
void Loader::find_leavers() {
  const auto gives = [&](const spm::Cache::Room& room) {
    return cache_.slots_free() + leaving_.slots >= room.slots && cache_.blocks_free() + leaving_.blocks >= room.blocks;
  };
  if (settings_.keep_unwanted && gives(reserve_) && gives(needed_)) return;

  struct Candidate {
    bool recent, was_met;
    std::int64_t visit_before_ns, wanted_ns;  // less when longer ago
    Object* object;
    std::uint32_t region;
    [[nodiscard]] auto order() const {
      return std::make_tuple(recent, recent || was_met, recent ? 0 : visit_before_ns, wanted_ns);
    }
  };
  std::vector<Candidate> candidates;
  for (Object* object : by_index_)
    for (const std::uint32_t region : object->held) {
      const RegionNote& note = object->notes[region];
      const std::int64_t unwanted_ns = note.unwanted_ns(wanted_at_ns_);
      if (unwanted_ns == 0) continue;
      const bool recent = unwanted_ns < settings_.idle_before_spare_ns;
      candidates.push_back({recent, note.met != 0, -note.since_visit_ns(wanted_at_ns_), -unwanted_ns, object, region});
    }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.order() < b.order(); });
  for (const Candidate& candidate : candidates) {
    if (settings_.keep_unwanted && gives(needed_) && gives(reserve_)) break;
    Object& object = *candidate.object;
    if (!delivery_.retire(object.info.id, candidate.region)) continue;
    const spm::Cache::Room room = cache_.room_of(spm::ObjectIndex{object.info.index}, spm::RegionId{candidate.region});
    object.notes[candidate.region].set(RegionState::kLeaving);
    object.held.erase(std::find(object.held.begin(), object.held.end(), candidate.region));
    leavers_.push_back({&object, candidate.region, room});
    leaving_.slots += room.slots;
    leaving_.blocks += room.blocks;
  }
}

void Loader::forget_leaver(const Object& object, std::uint32_t region) {
  const auto at = std::find_if(leavers_.begin(), leavers_.end(), [&](const Leaver& leaver) {
    return leaver.object == &object && leaver.region == region;
  });
  leaving_.slots -= at->room.slots;
  leaving_.blocks -= at->room.blocks;
  leavers_.erase(at);
}

void Loader::take_back(Object& object, std::uint32_t region) {
  forget_leaver(object, region);
  object.notes[region].set(RegionState::kHeld);
  object.held.push_back(region);
  delivery_.held(object.info.id, region);
}

/// Has regions coarsened until there will be room for what is wanted: spare ones, then those that hosts may still count
/// on, at the price of a message that comes incomplete.
void Loader::let_go() {
  constexpr std::uint32_t kAtOnce = 16;
  spm::Cache::Room coming{cache_.slots_free(), cache_.blocks_free()};
  const auto count = [&](const Leaver& leaver) {
    coming.slots += leaver.room.slots;
    coming.blocks += leaver.room.blocks;
  };
  const auto note = [](const Leaver& leaver) -> RegionNote& { return leaver.object->notes[leaver.region]; };
  for (const Leaver& leaver : leavers_)
    if (note(leaver).state() == RegionState::kDeparting) count(leaver);
  for (const Leaver& leaver : leavers_) {
    const bool enough = settings_.keep_unwanted && coming.slots >= needed_.slots && coming.blocks >= needed_.blocks;
    if (enough || departing_ == kAtOnce) return;
    if (note(leaver).state() != RegionState::kSpare) continue;
    note(leaver).set(RegionState::kDeparting);
    ++departing_;
    count(leaver);
    waiting_.push_back({Arrival::Kind::kRetire, &leaver.object->touch, spm::RegionId{leaver.region}, {}});
  }
}

void Loader::take_departures() {
  for (Object* object : by_index_)
    for (const std::uint32_t region : delivery_.take_released(object->info.id))
      if (object->notes[region].state() == RegionState::kLeaving) object->notes[region].set(RegionState::kSpare);
  Departure departure;
  while (departures_.pop(departure)) {
    Object& object = *by_index_[departure.object];
    const std::uint32_t region = spm::index(departure.region);
    cache_.release(spm::ObjectIndex{object.info.index}, departure.region);
    forget_leaver(object, region);
    object.notes[region].set(RegionState::kAbsent);
    ++object.info.regions_released;
    ++figures_.regions_evicted;
    --departing_;
  }
}

void Loader::hand_over() {
  while (!waiting_.empty() && arrivals_.push(waiting_.front())) waiting_.pop_front();
}

void Loader::find_near(const std::array<ProbeSight, kMaxProbes>& sights, std::array<NearObjects, kMaxProbes>& near) {
  near.fill({});
  std::uint64_t sought = 0;
  for (const Object* object : by_index_) sought |= std::uint64_t{1} << object->info.index;
  std::vector<spm::fcl::ProbeBall> balls;
  std::vector<std::uint32_t> numbers;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    if (!sights[i].active || !sights[i].device.allFinite()) continue;
    near[i] = {0, sought, plain(sights[i].device), settings_.near_distance / 2};  // the proxy lags behind the device
    balls.push_back({sights[i].device, settings_.radius + settings_.near_distance});
    numbers.push_back(i);
  }
  for (const spm::fcl::NearPair& pair : broad_phase_.near(spm::Span<const spm::fcl::ProbeBall>{balls}))
    near[numbers[pair.probe]].found |= std::uint64_t{1} << pair.object;
}

void Loader::tick(std::int64_t now_ns, const std::array<ProbeSight, kMaxProbes>& sights,
                  std::array<NearObjects, kMaxProbes>& near) {
  take_departures();
  take_messages(now_ns);
  prospects_.clear();
  for (Object* object : by_index_) predict(*object, sights);
  want(now_ns);
  find_leavers();
  let_go();
  hand_over();
  find_near(sights, near);
}

LoaderFigures Loader::figures() const {
  LoaderFigures figures = figures_;
  figures.slots_used = cache_.slots_used();
  figures.slots_limit = pool_.settings.slots;
  for (const Object* object : by_index_) figures.regions_held += object->held.size();
  figures.regions_held += leavers_.size();
  for (const Leaver& leaver : leavers_)
    figures.regions_spare += leaver.object->notes[leaver.region].state() == RegionState::kSpare ? 1 : 0;
  return figures;
}

std::vector<Loader::ObjectInfo> Loader::objects() const {
  std::vector<ObjectInfo> infos;
  for (const Object* object : by_index_) infos.push_back(object->info);
  return infos;
}

std::vector<std::uint32_t> Loader::regions_met(std::uint32_t object_index,
                                               const std::array<ProbeSight, kMaxProbes>& sights) const {
  std::vector<std::uint32_t> met;
  const Object& object = *by_index_[object_index];
  const Placement& placement = object.touch.placement;
  for (const ProbeSight& sight : sights)
    if (sight.active)
      object.grid().for_each_meeting(placement.to_model(sight.device), settings_.radius / placement.scale(),
                                     [&](spm::RegionId region, double) { met.push_back(spm::index(region)); });
  return met;
}

std::vector<std::uint32_t> Loader::predicted(std::uint32_t object_index) const {
  std::vector<std::uint32_t> regions;
  if (object_index < by_index_.size())
    for (const auto& [region, wish] : by_index_[object_index]->wishes) regions.push_back(region);
  return regions;
}

}  // namespace tactus::hrtc_service
