#include "hrtc_service/loader.hpp"

#include <malloc.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include "spm/codec/base_codec.hpp"

namespace tactus::hrtc_service {
namespace {

constexpr double kNsPerS = 1e9;
// After this age, a prediction is repeated even if the tips have hardly moved.
constexpr std::int64_t kStaleNs = 50'000'000;
constexpr double kMinDamping = 3e-3;  // s, times a body's stiffness; docs/explanation/shared-objects.md

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
      shape_{shape_of_probe(settings.tool, settings.radius)},
      arrivals_{arrivals},
      departures_{departures},
      cache_{pool},
      store_{pool.settings.compressed_blocks},
      delivery_{self, settings.delivery} {}

Loader::~Loader() = default;

void Loader::on_catalogue(const session::CatalogueEntry& entry) {
  change_offers([&] { delivery_.offer(entry); });
  if (!entry.withdrawn) open(entry);
}

void Loader::open(const session::CatalogueEntry& entry) {
  const auto known = objects_.find(entry.object_id);
  if (known != objects_.end()) {
    const bool same = known->second->summary.digest == entry.summary.digest;
    if (same && !known->second->withdrawn) return;
    if (!same && !known->second->withdrawn)
      say("object " + entry.object + ": host " + entry.host +
          " offers a different model under the same name; ignored as long as the first is there");
    return postpone(entry);
  }
  if (objects_.size() == kMaxObjects) {
    say("object " + entry.object + ": ignored as long as there are " + std::to_string(kMaxObjects) +
        " others, the most in one HRTC");
    return postpone(entry);
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
  if (on_object_found) on_object_found(entry);
  say("object " + entry.object + " found at host " + entry.host + ": " + std::to_string(entry.summary.faces) +
      " faces, " + std::to_string(entry.summary.regions) + " regions");
}

/// False when it does not fit. A base mesh above the bound of incomplete messages would be dropped again and again.
bool Loader::take_directory(Object& object) {
  const auto mib = [](std::uint64_t bytes) { return static_cast<double>(bytes) / (1 << 20); };
  if (object.entry.base_bytes > settings_.delivery.max_partial_bytes) {
    object.refused = true;
    ++figures_.objects_refused;
    char sizes[128];
    std::snprintf(sizes, sizeof sizes, "of %.1f MiB is larger than an HRTC assembles, %.1f MiB",
                  mib(object.entry.base_bytes), mib(settings_.delivery.max_partial_bytes));
    say("object " + object.info.name + ": refused, its base mesh " + sizes + "; build the model with a smaller one");
    return false;
  }
  const std::uint64_t takes = spm::directory_bytes(object.summary, pool_.settings);
  const std::uint64_t left = settings_.directory_bytes - directories_;
  if (takes <= left) {
    directories_ += takes;
    return true;
  }
  object.refused = true;
  ++figures_.objects_refused;
  char sizes[128];
  std::snprintf(sizes, sizeof sizes, "takes %.1f MiB, %.1f of %.1f MiB are left", mib(takes), mib(left),
                mib(settings_.directory_bytes));
  say("object " + object.info.name + ": refused, its directory of " + std::to_string(object.summary.regions) +
      " regions " + sizes + "; raise --memory");
  return false;
}

/// Withdraws the objects that a host offered before `change` and that no host offers after it.
template <class Change>
void Loader::change_offers(Change&& change) {
  std::vector<Object*> offered;
  for (Object* object : active_)
    if (delivery_.offered(object->info.id, object->info.digest)) offered.push_back(object);
  change();
  for (Object* object : offered)
    if (!delivery_.offered(object->info.id, object->info.digest)) withdraw(*object);
}

void Loader::drop_parked(const Object& object) {
  for (const Parked& parked : parked_)
    if (parked.object == &object) parked_bytes_ -= parked.message.bytes.size();
  parked_.erase(
      std::remove_if(parked_.begin(), parked_.end(), [&](const Parked& parked) { return parked.object == &object; }),
      parked_.end());
}

/// An object that is not shown yet is removed with the last host that offers it.
void Loader::forget_unoffered(std::int64_t now_ns) {
  constexpr std::int64_t kLookNs = 1'000'000'000;
  if (now_ns - looked_at_offers_ns_ < kLookNs) return;
  looked_at_offers_ns_ = now_ns;
  std::vector<std::uint64_t> unoffered;
  for (const auto& [id, object] : objects_)
    if (!object->ready && !delivery_.offered(id, object->info.digest)) unoffered.push_back(id);
  for (const std::uint64_t id : unoffered) {
    Object& object = *objects_.at(id);
    say("object " + object.info.name + ": no host offers it any more");
    delivery_.close(id);
    drop_parked(object);
    if (!object.refused) directories_ -= spm::directory_bytes(object.summary, pool_.settings);
    forget(object);
  }
  if (!unoffered.empty()) open_postponed();
}

void Loader::on_host_seen(std::uint64_t host, std::uint64_t incarnation, std::int64_t now_ns) {
  delivery_.host_seen(host, incarnation, now_ns);
}

void Loader::on_host_gone(std::uint64_t host) { delivery_.host_gone(host); }

void Loader::on_host_left(std::uint64_t host, std::uint64_t incarnation) {
  change_offers([&] { delivery_.host_left(host, incarnation); });
}

void Loader::on_host_silent(std::uint64_t host) { delivery_.suspect_host(host); }

void Loader::on_chunk(const session::BulkChunk& chunk, std::int64_t now_ns) {
  for (session::DeliveryClient::Message& message : delivery_.on_chunk(chunk, now_ns)) {
    const auto found = objects_.find(message.object_id);
    if (found == objects_.end()) continue;
    if (message.kind == session::BulkKind::kBase) {
      take_base(*found->second, std::exchange(message.bytes, {}));
      malloc_trim(0);  // the temporary memory of a base mesh is as large as the mesh
    } else {
      take(*found->second, std::move(message), now_ns);
    }
    hand_over();
  }
}

void Loader::take_base(Object& object, const std::vector<std::uint8_t>& bytes) {
  auto decoded = spm::codec::decode_base(std::span<const std::uint8_t>{bytes});
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
    return delivery_.base_held(object.info.id);  // another request would change nothing
  }
  object.base_slots = free_before - cache_.slots_free();
  object.base_nodes = nodes;
  base_slots_ += object.base_slots;
  base_nodes_ += nodes;
  object.summary = base.summary;
  object.tables = std::move(decoded->tables);
  store_.admit(admitted.object, object.summary, object.tables);
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
  touch.digest = object.info.digest;
  touch.name = object.info.name;
  touch.placement = Placement{object.entry.pose, object.entry.scale};
  touch.material = object.entry.material;
  if (sharing::can_move(object.entry)) {
    touch.body = sharing::body_of(object.entry);
    touch.material.damping = std::max(touch.material.damping, kMinDamping * touch.material.stiffness);
  }
  object.placement = touch.placement;
  touch.bounds = {wide(object.summary.bounds_min), wide(object.summary.bounds_max)};
  touch.deviation = object.summary.deviation;
  touch.forest =
      std::make_unique<spm::Forest>(pool_, nodes_, spm::ObjectIndex{touch.index}, object.summary,
                                    spm::RegionGrid{object.summary.grid, base.regions}, std::move(admitted.base));
  const double scale = object.entry.scale;
  const spm::PredictionSettings prediction{0, settings_.margin / scale, settings_.min_speed / scale,
                                           settings_.strategy};
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    object.predictors.emplace_back(object.grid(), shape_, scale, prediction);
  broad_phase_.put(touch.index, world_box(touch.bounds, touch.placement));
  by_index_[touch.index] = &object;
  active_.push_back(&object);
  object.ready = true;
  predicted_ns_ = predict_next_ns_ = 0;
  waiting_.push_back({Arrival::Kind::kObject, &touch, {}, {}});
  if (on_object) on_object(touch);
  delivery_.base_held(object.info.id);
}

/// Whether the last prediction is still good enough: the tips have hardly moved since, or a new one would exceed its
/// share of the time. (On an overloaded machine loading takes longer, so prediction must look further ahead.)
bool Loader::still_ahead(std::int64_t now_ns, const std::array<ProbeSight, kMaxProbes>& sights) const {
  constexpr double kHardly = 0.1;  // of the tip's radius
  bool moved = now_ns - predicted_ns_ >= kStaleNs;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const ProbeSight &before = predicted_for_[i], &sight = sights[i];
    if (sight.active != before.active || sight.in_contact != before.in_contact) return false;
    moved = moved || (sight.active && !(this->moved(sight, before) <= kHardly * settings_.radius));
  }
  return !moved || now_ns < predict_next_ns_;
}

/// World. The reported pose for a tool, the device's position for a tip.
Vec3d Loader::centre(const ProbeSight& sight, const spm::ProbeSphere& sphere) const noexcept {
  return settings_.tool == nullptr ? sight.device : Vec3d{sight.proxy + sight.orientation * sphere.centre};
}

/// The spheres of a probe in the frame of an object with that placement.
std::span<const spm::PlacedSphere> Loader::spheres(const ProbeSight& sight, const Placement& placement,
                                                   PlacedSpheres& out) const noexcept {
  const std::span<const spm::ProbeSphere> spheres = shape_.spheres();
  std::transform(spheres.begin(), spheres.end(), out.begin(), [&](const spm::ProbeSphere& sphere) {
    return placed({centre(sight, sphere), Vec3d::Zero(), sphere.radius}, placement);
  });
  return {out.data(), spheres.size()};
}

/// m; the largest displacement.
double Loader::moved(const ProbeSight& sight, const ProbeSight& before) const noexcept {
  double furthest = 0;
  for (const spm::ProbeSphere& sphere : shape_.spheres())
    furthest = std::max(furthest, (centre(sight, sphere) - centre(before, sphere)).norm());
  return furthest;
}

void Loader::observe(Object& object, const std::array<ProbeSight, kMaxProbes>& sights) const {
  PlacedSpheres out;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i)
    if (sights[i].active)
      object.predictors[i].observe(static_cast<double>(sights[i].time_ns) / kNsPerS,
                                   spheres(sights[i], object.placement, out), sights[i].in_contact);
}

/// s; the horizon of the prediction.
double Loader::lead(double round_trip) const {
  // A demand waits for its due time, its answer for the next tick and cycle.
  constexpr double kTurnaround = 0.015;  // s
  return std::clamp(1.25 * round_trip + kTurnaround, settings_.min_lead, settings_.max_lead);
}

void Loader::predict(std::int64_t now_ns, const std::array<ProbeSight, kMaxProbes>& sights) {
  constexpr std::int64_t kRest = 20;  // times the duration
  constexpr double kMaxRest = 0.25;   // of the horizon
  const auto clock_ns = [this] { return settings_.clock == nullptr ? 0 : settings_.clock(); };
  const std::int64_t began = clock_ns();
  const double round_trip = static_cast<double>(delivery_.round_trip_ns()) / kNsPerS;
  const double ahead = lead(round_trip);
  predicted_ns_ = now_ns;
  predicted_for_ = sights;
  prospects_.clear();
  for (Object* object : active_) predict(*object, sights, round_trip, ahead);
  predict_next_ns_ =
      now_ns + std::min(kRest * (clock_ns() - began), static_cast<std::int64_t>(kMaxRest * ahead * kNsPerS));
}

void Loader::predict(Object& object, const std::array<ProbeSight, kMaxProbes>& sights, double round_trip, double lead) {
  const Placement& placement = object.placement;
  met_.clear();
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const ProbeSight& sight = sights[i];
    if (!sight.active) continue;
    object.predictors[i].predict(lead, met_);
    // The proxy lags behind a device that is pressed in, and must stand on the finest surface too.
    if (sight.in_contact && settings_.tool == nullptr)
      object.grid().for_each_meeting(placement.to_model(sight.proxy),
                                     (settings_.radius + settings_.margin) / placement.scale(),
                                     [&](spm::RegionId region, double) {
                                       met_.add({region, 0, lead, 0});
                                     });
  }
  predict_under_bodies(object, sights, lead);
  met_.sort();
  std::vector<spm::PredictedRegion> met{met_.entries().begin(), met_.entries().end()};
  std::sort(met.begin(), met.end(), [](const auto& a, const auto& b) { return a.region < b.region; });

  auto next = met.begin();
  for (auto wish = object.wishes.begin(); wish != object.wishes.end();) {
    while (next != met.end() && spm::index(next->region) < wish->first) ++next;
    const bool still = next != met.end() && spm::index(next->region) == wish->first;
    wish = still ? std::next(wish) : object.wishes.erase(wish);
  }
  for (const spm::PredictedRegion& region : met) {
    // A region that cannot arrive before the tip leaves it comes last.
    constexpr double kTooLate = 1e3;
    const std::uint32_t number = spm::index(region.region);
    const bool in_time = !object.notes[number].absent() || region.contact_until >= round_trip;
    prospects_.push_back({region.doubt + (in_time ? 0 : kTooLate),
                          in_time ? region.contact_in : lead + region.contact_in, region.contact_in, &object, number,
                          &object.wishes[number]});
  }
}

void Loader::predict_under_bodies(const Object& object, const std::array<ProbeSight, kMaxProbes>& sights, double lead) {
  if (object.touch.body) return;
  const auto hand_near = [&](const Vec3d& point, double distance) {
    return std::any_of(sights.begin(), sights.end(), [&](const ProbeSight& sight) {
      return sight.active && (sight.device - point).squaredNorm() < distance * distance;
    });
  };
  for (const Object* const other : active_)
    if (other->touch.body)
      for_each_place_under(*other->touch.body, other->placement, object.touch.bounds, object.placement, hand_near,
                           [&](const Vec3d& place, double radius) {
                             object.grid().for_each_meeting(place, radius, [&](spm::RegionId region, double) {
                               met_.add({region, 0, lead, 0});
                             });
                           });
}

void Loader::on_moved(std::uint32_t object_index, const Placement& placement) {
  if (object_index >= kMaxObjects || by_index_[object_index] == nullptr || !placement.valid()) return;
  Object& object = *by_index_[object_index];
  object.placement = placement;
  if (object.withdrawn) return;
  predicted_ns_ = 0;  // a tip at rest may be touched
  broad_phase_.put(object_index, world_box(object.touch.bounds, placement));
}

void Loader::hand_over() {
  while (!waiting_.empty() && arrivals_.push(waiting_.front())) waiting_.pop_front();
}

void Loader::find_near(const std::array<ProbeSight, kMaxProbes>& sights, std::array<NearObjects, kMaxProbes>& near) {
  near.fill({});
  std::uint64_t sought = 0;
  for (const Object* object : active_) sought |= std::uint64_t{1} << object->info.index;
  std::vector<spm::fcl::ProbeSphere> spheres;
  std::vector<std::uint32_t> numbers;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    if (!sights[i].active || !sights[i].device.allFinite()) continue;
    near[i] = {0, sought, plain(sights[i].device), settings_.near_distance / 2};  // the proxy lags behind the device
    const double reach = std::max(settings_.radius, shape_.reach());
    spheres.push_back({sights[i].device, reach + settings_.near_distance});
    numbers.push_back(i);
  }
  for (const spm::fcl::NearPair& pair : broad_phase_.near(std::span<const spm::fcl::ProbeSphere>{spheres}))
    near[numbers[pair.probe]].found |= std::uint64_t{1} << pair.object;
}

void Loader::tick(std::int64_t now_ns, const std::array<ProbeSight, kMaxProbes>& sights,
                  std::array<NearObjects, kMaxProbes>& near) {
  take_departures();
  take_released();
  take_parked(now_ns);
  forget_unoffered(now_ns);
  for (Object* object : active_) observe(*object, sights);
  constexpr std::int64_t kAtRestNs = 100'000'000;
  if (!still_ahead(now_ns, sights)) {
    if (now_ns - predicted_ns_ < kStaleNs) moved_ns_ = now_ns;
    predict(now_ns, sights);
  }
  want(now_ns);
  at_rest_ = needed_ == 0 && now_ns - moved_ns_ >= kAtRestNs;
  find_eviction_candidates();
  show_due();
  coarsen();
  hand_over();
  find_near(sights, near);
}

LoaderFigures Loader::figures() const {
  LoaderFigures figures = figures_;
  figures.slots_used = cache_.slots_used();
  figures.slots_limit = pool_.settings.slots;
  figures.compressed_used = store_.blocks() - store_.blocks_free();
  figures.compressed_limit = store_.blocks();
  for (const Object* object : active_) {
    figures.regions_held += object->held.size();
    figures.regions_shown += object->shown.size();
  }
  figures.regions_held += eviction_candidates_.size();
  for (const Place& eviction_candidate : eviction_candidates_)
    figures.regions_spare += eviction_candidate.object->notes[eviction_candidate.region].kept() == Kept::kSpare ? 1 : 0;
  return figures;
}

std::vector<Loader::ObjectInfo> Loader::objects() const {
  std::vector<ObjectInfo> infos;
  for (const Object* object : active_) infos.push_back(object->info);
  return infos;
}

std::vector<Loader::ObjectInfo> Loader::leaving() const {
  std::vector<ObjectInfo> infos;
  for (const Object* object : by_index_)
    if (object != nullptr && object->withdrawn) infos.push_back(object->info);
  return infos;
}

std::vector<std::uint32_t> Loader::regions_met(std::uint32_t object_index,
                                               const std::array<ProbeSight, kMaxProbes>& sights) const {
  std::vector<std::uint32_t> met;
  const Object& object = *by_index_[object_index];
  const Placement& placement = object.placement;
  PlacedSpheres out;
  for (const ProbeSight& sight : sights)
    if (sight.active)
      for (const spm::PlacedSphere& sphere : spheres(sight, placement, out))
        object.grid().for_each_meeting(sphere.centre, sphere.radius,
                                       [&](spm::RegionId region, double) { met.push_back(spm::index(region)); });
  return met;
}

std::vector<std::uint32_t> Loader::predicted(std::uint32_t object_index) const {
  std::vector<std::uint32_t> regions;
  if (object_index < kMaxObjects && by_index_[object_index] != nullptr)
    for (const auto& [region, wish] : by_index_[object_index]->wishes) regions.push_back(region);
  return regions;
}

}  // namespace tactus::hrtc_service
