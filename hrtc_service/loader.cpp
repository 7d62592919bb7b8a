#include "hrtc_service/loader.hpp"

#include <malloc.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include "session/units.hpp"

namespace tactus::hrtc_service {
namespace {

// A prediction of this age is repeated even if no probe has moved.
constexpr std::int64_t kMaxPredictionAgeNs = 50'000'000;

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

}  // namespace

Loader::Loader(const spm::PoolSettings& pool, const session::Origin& self, const LoaderSettings& settings,
               IntakeLink& link)
    : pool_{pool},
      settings_{settings},
      shape_{shape_of_probe(settings.tool, settings.radius)},
      intake_{link, pool},
      store_{pool.compressed_blocks},
      delivery_{self, settings.delivery} {}

Loader::~Loader() = default;

void Loader::on_catalogue(const session::CatalogueEntry& entry) {
  change_offers([&] { delivery_.on_catalogue(entry); });
  if (!entry.withdrawn) open(entry);
}

void Loader::open(const session::CatalogueEntry& entry) {
  const auto known = objects_.find(entry.object_id);
  if (known != objects_.end()) {
    const bool same = known->second->summary.digest == entry.summary.digest;
    if (same && !known->second->withdrawn) return;
    if (!same && !known->second->withdrawn)
      report_warning("object " + entry.object + ": host '" + entry.host +
                     "' serves another model of this name, which is ignored while host '" + known->second->entry.host +
                     "' serves its model; rename one of the two objects");
    return postpone(entry);
  }
  if (objects_.size() == kMaxObjects) {
    report_warning("object " + entry.object + ": ignored while there are " + std::to_string(kMaxObjects) +
                   " others, the maximum of an HRTC");
    return postpone(entry);
  }
  auto object = std::make_unique<Object>(entry, max_pages_of(entry.summary));
  object->info.name = entry.object;
  object->info.id = entry.object_id;
  object->info.digest = entry.summary.digest;
  object->info.scale = entry.scale;
  Object& added = *object;
  objects_[entry.object_id] = std::move(object);
  if (!reserve_directory(added)) return;
  last_prediction_ns_ = next_prediction_ns_ = 0;  // the first demand requests pages, too
  delivery_.open(entry.object_id, entry.summary.digest);
  if (on_object_found) on_object_found(entry);
  report_info("object " + entry.object + " found at host " + entry.host + ": " + std::to_string(entry.summary.faces) +
              " faces, " + std::to_string(entry.summary.regions) + " regions");
}

/// Reserves memory for the directory of an object. Returns false and marks the object as refused if it does not fit, or
/// if its base mesh is larger than `max_partial_bytes`, so that it could never be assembled.
bool Loader::reserve_directory(Object& object) {
  const auto mib = [](std::uint64_t bytes) { return static_cast<double>(bytes) / (1 << 20); };
  if (object.entry.base_bytes > settings_.delivery.max_partial_bytes) {
    object.refused = true;
    ++figures_.objects_refused;
    char sizes[128];
    std::snprintf(sizes, sizeof sizes, "of %.1f MiB is larger than an HRTC assembles, %.1f MiB",
                  mib(object.entry.base_bytes), mib(settings_.delivery.max_partial_bytes));
    report_warning("object " + object.info.name + ": refused, its base mesh " + sizes +
                   "; build the model with a smaller one");
    return false;
  }
  const std::uint64_t takes = spm::directory_bytes(object.summary, pool_, max_pages_of(object.summary));
  const std::uint64_t left = settings_.directory_bytes - directory_bytes_;
  if (takes <= left) {
    directory_bytes_ += object.directory_bytes = takes;
    return true;
  }
  object.refused = true;
  ++figures_.objects_refused;
  char sizes[128];
  std::snprintf(sizes, sizeof sizes, "takes %.1f MiB, %.1f of %.1f MiB are left", mib(takes), mib(left),
                mib(settings_.directory_bytes));
  report_warning("object " + object.info.name + ": refused, its directory " + sizes + "; raise --memory");
  return false;
}

void Loader::release_directory(Object& object) noexcept {
  directory_bytes_ -= std::exchange(object.directory_bytes, 0);
}

/// Returns the max number of pages that the loader requests of an object.
std::uint32_t Loader::max_pages_of(const spm::ModelSummary& summary) const noexcept {
  const std::uint32_t in_bounds = spm::RegionGrid::pages_in_bounds(summary);
  return std::min(in_bounds, settings_.wants_whole_directory ? std::min(summary.regions, spm::kMaxWholePages)
                                                             : spm::kMaxObjectPages);
}

/// Withdraws the objects that a host offered before `change` and that no host offers after it.
template <class Change>
void Loader::change_offers(Change&& change) {
  std::vector<Object*> offered;
  for (Object* object : active_)
    if (delivery_.is_offered(object->info.id, object->info.digest)) offered.push_back(object);
  change();
  for (Object* object : offered)
    if (!delivery_.is_offered(object->info.id, object->info.digest)) withdraw(*object);
}

void Loader::drop_waiting(const Object& object) {
  for (const WaitingMessage& waiting : waiting_messages_)
    if (waiting.object == &object) waiting_bytes_ -= waiting.message.bytes.size();
  waiting_messages_.erase(std::remove_if(waiting_messages_.begin(), waiting_messages_.end(),
                                         [&](const WaitingMessage& waiting) { return waiting.object == &object; }),
                          waiting_messages_.end());
}

/// Removes the objects whose base mesh is not in the pool, if no host offers them any more.
void Loader::forget_unoffered(std::int64_t now_ns) {
  constexpr std::int64_t kOfferCheckNs = 1'000'000'000;
  if (now_ns - offers_checked_ns_ < kOfferCheckNs) return;
  offers_checked_ns_ = now_ns;
  std::vector<std::uint64_t> unoffered;
  for (const auto& [id, object] : objects_)
    if (!object->ready && !delivery_.is_offered(id, object->info.digest)) unoffered.push_back(id);
  for (const std::uint64_t id : unoffered) {
    Object& object = *objects_.at(id);
    report_info("object " + object.info.name + ": no host offers it any more");
    delivery_.close(id);
    drop_waiting(object);
    drop_pending_base(object);
    release_directory(object);
    forget(object);
  }
  if (!unoffered.empty()) open_postponed();
}

void Loader::on_host_heartbeat(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns) {
  delivery_.on_host_heartbeat(host, incarnation, now_ns);
}

void Loader::on_host_gone(std::uint64_t host) { delivery_.on_host_gone(host); }

void Loader::on_host_left(std::uint64_t host, std::uint64_t incarnation) {
  change_offers([&] { delivery_.on_host_left(host, incarnation); });
}

void Loader::on_host_silent(std::uint64_t host) { delivery_.suspect_host(host); }

void Loader::on_chunk(const session::BulkChunk& chunk, std::int64_t now_ns) {
  for (session::DeliveryClient::Message& message : delivery_.on_chunk(chunk, now_ns)) {
    const auto found = objects_.find(message.object_id);
    if (found == objects_.end()) continue;
    if (message.kind == session::BulkKind::kBase) {
      on_base_mesh(*found->second, std::exchange(message.bytes, {}));
#ifdef __GLIBC__
      malloc_trim(0);  // returns the temporary memory to the system, because it is as large as the base mesh
#endif
    } else if (session::is_of_directory(message.region)) {
      on_pages(*found->second, message);
    } else {
      on_region(*found->second, std::move(message), now_ns);
    }
    intake_.flush();
  }
}

/// Returns whether the last prediction is still good enough: the probes have hardly moved since, or a new prediction
/// would exceed its share of the processor time.
bool Loader::prediction_is_current(std::int64_t now_ns, const std::array<ReportedProbe, kMaxProbes>& probes) const {
  constexpr double kMaxMotion = 0.1;  // tip radii
  bool moved = now_ns - last_prediction_ns_ >= kMaxPredictionAgeNs;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const ReportedProbe &before = predicted_probes_[i], &probe = probes[i];
    if (probe.active != before.active || probe.in_contact != before.in_contact) return false;
    moved = moved || (probe.active && !(displacement(probe, before) <= kMaxMotion * settings_.radius));
  }
  return !moved || now_ns < next_prediction_ns_;
}

/// Returns the centre of one sphere of a probe, world frame. The sphere of a tip is at the device, a sphere of a tool
/// moves with the reported pose of the tool.
Vec3d Loader::sphere_centre(const ReportedProbe& probe, const spm::ProbeSphere& sphere) const noexcept {
  return settings_.tool == nullptr ? probe.device : Vec3d{probe.proxy + probe.orientation * sphere.centre};
}

/// Returns the spheres of a probe in the model frame of an object with that placement. `out` is their storage.
std::span<const spm::PlacedSphere> Loader::spheres(const ReportedProbe& probe, const Placement& placement,
                                                   PlacedSpheres& out) const noexcept {
  const std::span<const spm::ProbeSphere> spheres = shape_.spheres();
  std::transform(spheres.begin(), spheres.end(), out.begin(), [&](const spm::ProbeSphere& sphere) {
    return placed({sphere_centre(probe, sphere), Vec3d::Zero(), sphere.radius}, placement);
  });
  return {out.data(), spheres.size()};
}

/// Returns the largest displacement of a sphere of the probe, m.
double Loader::displacement(const ReportedProbe& probe, const ReportedProbe& before) const noexcept {
  double furthest = 0;
  for (const spm::ProbeSphere& sphere : shape_.spheres())
    furthest = std::max(furthest, (sphere_centre(probe, sphere) - sphere_centre(before, sphere)).norm());
  return furthest;
}

/// Measures how fast the probes move. The speeds decay within some ticks, so that a short stop has no effect.
void Loader::measure_speeds(const std::array<ReportedProbe, kMaxProbes>& probes) {
  constexpr double kDecay = 0.9;  // of a tick
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const ReportedProbe& before = std::exchange(measured_probes_[i], probes[i]);
    const double elapsed = static_cast<double>(probes[i].time_ns - before.time_ns) / kNsPerS;
    const bool has_moved = probes[i].active && before.active && elapsed > 0;
    const double speed = has_moved ? displacement(probes[i], before) / elapsed : 0;
    speeds_[i] = std::max(kDecay * speeds_[i], speed);
  }
}

void Loader::observe(Object& object, const std::array<ReportedProbe, kMaxProbes>& probes) const {
  PlacedSpheres out;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    if (probes[i].active)
      object.predictors[i].observe(static_cast<double>(probes[i].time_ns) / kNsPerS,
                                   spheres(probes[i], object.placement, out), probes[i].in_contact);
}

/// Returns the horizon of the prediction, s.
double Loader::horizon(double round_trip) const {
  // A demand waits until it is due, and its answer until the next tick and cycle.
  constexpr double kTurnaround = 0.015;  // s
  return std::clamp(1.25 * round_trip + kTurnaround, settings_.min_lead, settings_.max_lead);
}

void Loader::predict(std::int64_t now_ns, const std::array<ReportedProbe, kMaxProbes>& probes) {
  constexpr std::int64_t kPauseFactor = 20;  // pause until the next prediction / duration of this one
  constexpr double kMaxPauseShare = 0.25;    // max pause / horizon
  const auto clock_ns = [this] { return settings_.clock == nullptr ? 0 : settings_.clock(); };
  const std::int64_t began = clock_ns();
  const double round_trip = static_cast<double>(delivery_.round_trip_ns()) / kNsPerS;
  const double ahead = horizon(round_trip);
  last_prediction_ns_ = now_ns;
  predicted_probes_ = probes;
  predicted_contacts_.clear();
  for (Object* object : active_) predict(*object, probes, round_trip, ahead);
  for (const auto& [id, object] : objects_)
    if (!object->ready && !object->refused) find_missing_pages(*object, probes, ahead);
  next_prediction_ns_ = now_ns + std::min(kPauseFactor * (clock_ns() - began),
                                          static_cast<std::int64_t>(kMaxPauseShare * ahead * kNsPerS));
}

void Loader::predict(Object& object, const std::array<ReportedProbe, kMaxProbes>& probes, double round_trip,
                     double lead) {
  const Placement& placement = object.placement;
  predicted_regions_.clear();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const ReportedProbe& probe = probes[i];
    if (!probe.active) continue;
    object.predictors[i].predict(lead, predicted_regions_);
    // When a device is pressed into a surface, its proxy stays on the surface, away from the device. The mesh around
    // the proxy must be the finest, too.
    if (probe.in_contact && settings_.tool == nullptr)
      object.grid.for_each_intersecting(placement.to_model(probe.proxy),
                                        (settings_.radius + settings_.margin) / placement.scale(),
                                        [&](spm::RegionId region, double) {
                                          predicted_regions_.add({region, 0, lead, 0});
                                        });
  }
  find_missing_pages(object, probes, lead);
  predict_under_bodies(object, probes, lead);
  object.predicted.clear();
  for (const spm::PredictedRegion& region : predicted_regions_.entries())
    object.predicted.push_back(spm::index(region.region));
  constexpr double kSoon = 0.02, kLater = 0.5, kContactEnd = 1e9;  // s
  for (const std::uint32_t region : object.also_wanted)
    predicted_regions_.add({spm::RegionId{region}, kSoon, kContactEnd, 0});
  for (const std::uint32_t region : object.wanted_later)
    predicted_regions_.add({spm::RegionId{region}, kLater, kContactEnd, 0});
  predicted_regions_.sort();
  std::vector<spm::PredictedRegion> predicted{predicted_regions_.entries().begin(), predicted_regions_.entries().end()};
  std::sort(predicted.begin(), predicted.end(), [](const auto& a, const auto& b) { return a.region < b.region; });

  auto next = predicted.begin();
  for (auto wanted_region = object.wanted_regions.begin(); wanted_region != object.wanted_regions.end();) {
    while (next != predicted.end() && spm::index(next->region) < wanted_region->first) ++next;
    const bool still = next != predicted.end() && spm::index(next->region) == wanted_region->first;
    wanted_region = still ? std::next(wanted_region) : object.wanted_regions.erase(wanted_region);
  }
  for (const spm::PredictedRegion& region : predicted) {
    // A region that cannot arrive before the contact ends is requested last.
    constexpr double kTooLatePenalty = 1e3;
    const std::uint32_t number = spm::index(region.region);
    const bool in_time = !object.note(number).is_absent() || region.contact_end >= round_trip;
    predicted_contacts_.push_back({region.sigmas_from_path + (in_time ? 0 : kTooLatePenalty),
                                   in_time ? region.time_to_contact : lead + region.time_to_contact,
                                   region.time_to_contact, &object, number, &object.wanted_regions[number]});
  }
}

void Loader::predict_under_bodies(Object& object, const std::array<ReportedProbe, kMaxProbes>& probes, double lead) {
  if (object.described.body) return;
  const auto has_hand_near = [&](const Vec3d& point, double distance) {
    return std::any_of(probes.begin(), probes.end(), [&](const ReportedProbe& probe) {
      return probe.active && (probe.device - point).squaredNorm() < distance * distance;
    });
  };
  for (const Object* const other : active_)
    if (other->described.body)
      for_each_sphere_under(*other->described.body, other->placement, object.bounds, object.placement, has_hand_near,
                            [&](const Vec3d& place, double radius) {
                              want_pages(object, place, radius, 0);
                              object.grid.for_each_intersecting(place, radius, [&](spm::RegionId region, double) {
                                predicted_regions_.add({region, 0, lead, 0});
                              });
                            });
}

void Loader::update_broad_phase(const Object& object) {
  broad_phase_.put(object.info.index, world_box(object.bounds, object.placement));
}

void Loader::on_moved(std::uint32_t object_index, const Placement& placement) {
  if (object_index >= kMaxObjects || by_index_[object_index] == nullptr || !placement.valid()) return;
  Object& object = *by_index_[object_index];
  object.placement = placement;
  if (object.withdrawn) return;
  last_prediction_ns_ = 0;  // the object may now touch a tip at rest
  update_broad_phase(object);
}

void Loader::want(std::uint32_t object_index, std::vector<std::uint32_t> regions, std::vector<std::uint32_t> later) {
  if (object_index >= kMaxObjects || by_index_[object_index] == nullptr) return;
  Object& object = *by_index_[object_index];
  for (std::vector<std::uint32_t>* const each : {&regions, &later})
    std::erase_if(*each, [&](std::uint32_t region) { return object.find_page(region) == nullptr; });
  if (regions == object.also_wanted && later == object.wanted_later) return;
  object.also_wanted = std::move(regions);
  object.wanted_later = std::move(later);
  last_prediction_ns_ = 0;  // no probe need have moved
}

void Loader::find_near(const std::array<ReportedProbe, kMaxProbes>& probes, std::array<NearObjects, kMaxProbes>& near) {
  near.fill({});
  std::uint64_t searched = 0;
  for (const Object* object : active_) searched |= std::uint64_t{1} << object->info.index;
  std::vector<spm::fcl::BoundingSphere> spheres;
  std::vector<std::uint32_t> numbers;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    if (!probes[i].active || !probes[i].device.allFinite()) continue;
    // Half of the distance is for motion of the device after this search, the other half for the distance between
    // device and proxy.
    near[i] = {0, searched, plain(probes[i].device), settings_.near_distance / 2};
    const double reach = std::max(settings_.radius, shape_.reach());
    spheres.push_back({probes[i].device, reach + settings_.near_distance});
    numbers.push_back(i);
  }
  for (const spm::fcl::NearPair& pair :
       broad_phase_.find_near_pairs(std::span<const spm::fcl::BoundingSphere>{spheres}))
    near[numbers[pair.probe]].found |= std::uint64_t{1} << pair.object;
}

void Loader::tick(std::int64_t now_ns, const std::array<ReportedProbe, kMaxProbes>& probes,
                  std::array<NearObjects, kMaxProbes>& near) {
  process_attach(now_ns);
  process_answers();
  withdraw_kept_objects(now_ns);
  admit_pending_bases();
  collect_released();
  store_waiting(now_ns);
  forget_unoffered(now_ns);
  measure_speeds(probes);
  for (Object* object : active_) observe(*object, probes);
  constexpr std::int64_t kAtRestNs = 100'000'000;
  if (!prediction_is_current(now_ns, probes)) {
    if (now_ns - last_prediction_ns_ < kMaxPredictionAgeNs) last_motion_ns_ = now_ns;
    predict(now_ns, probes);
  }
  request_wanted(now_ns);
  at_rest_ = blocks_needed_ == 0 && now_ns - last_motion_ns_ >= kAtRestNs;
  find_eviction_candidates();
  load_soonest();
  coarsen();
  intake_.flush();
  find_near(probes, near);
}

LoaderFigures Loader::figures() const {
  LoaderFigures figures = figures_;
  figures.slots_used = slots_used();
  figures.slots_limit = pool_.slots;
  figures.compressed_used = store_.blocks() - store_.blocks_free();
  figures.compressed_limit = store_.blocks();
  for (const Object* object : active_) {
    figures.regions_held += object->held.size();
    figures.regions_loaded += object->loaded.size();
  }
  figures.regions_held += eviction_candidates_.size();
  for (const RegionRef& candidate : eviction_candidates_)
    figures.regions_evictable +=
        candidate.object->note(candidate.region).store_state() == StoreState::kEvictable ? 1 : 0;
  return figures;
}

std::vector<Loader::ObjectInfo> Loader::objects() const {
  std::vector<ObjectInfo> infos;
  for (const Object* object : active_) infos.push_back(object->info);
  return infos;
}

std::vector<Loader::ObjectInfo> Loader::withdrawn_objects() const {
  std::vector<ObjectInfo> infos;
  for (const Object* object : by_index_)
    if (object != nullptr && object->withdrawn) infos.push_back(object->info);
  return infos;
}

std::vector<std::uint32_t> Loader::regions_at_probes(std::uint32_t object_index,
                                                     const std::array<ReportedProbe, kMaxProbes>& probes) const {
  std::vector<std::uint32_t> met;
  const Object& object = *by_index_[object_index];
  const Placement& placement = object.placement;
  PlacedSpheres out;
  for (const ReportedProbe& probe : probes)
    if (probe.active)
      for (const spm::PlacedSphere& sphere : spheres(probe, placement, out))
        object.grid.for_each_intersecting(sphere.centre, sphere.radius,
                                          [&](spm::RegionId region, double) { met.push_back(spm::index(region)); });
  return met;
}

std::vector<std::uint32_t> Loader::predicted(std::uint32_t object_index) const {
  std::vector<std::uint32_t> regions;
  if (object_index < kMaxObjects && by_index_[object_index] != nullptr)
    for (const auto& [region, wanted_region] : by_index_[object_index]->wanted_regions) regions.push_back(region);
  return regions;
}

std::vector<std::uint32_t> Loader::predicted_contacts(std::uint32_t object_index) const {
  if (object_index >= kMaxObjects || by_index_[object_index] == nullptr) return {};
  return by_index_[object_index]->predicted;
}

}  // namespace tactus::hrtc_service
