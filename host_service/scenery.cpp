#include "host_service/scenery.hpp"

#include <algorithm>
#include <cmath>

#include "spm/codec/region_codec.hpp"

namespace tactus::host_service {

namespace {

using haptics::Vec3d;

constexpr double kAround = sharing::kAroundBody;
constexpr int kMostNew = 8;  // regions decoded in a look
constexpr spm::Budget kAll{1u << 22};

std::uint32_t base_slots(const std::vector<StandingObject>& objects) {
  std::uint32_t slots = 0;
  for (const StandingObject& object : objects) slots += spm::Cache::slots_for_base(object.model->base());
  return slots;
}

/// The nodes of a pool for bases and what is refined beside them.
spm::PoolSettings pool_for(const std::vector<StandingObject>& objects, std::uint32_t slots) {
  const std::uint32_t base = base_slots(objects);
  spm::PoolSettings settings = spm::PoolSettings::for_slots(slots + base);
  settings.tree_nodes += base;
  return settings;
}

}  // namespace

struct Scenery::Object {
  const spm::codec::CodedModel* model;
  sharing::Placement placement;
  spm::CellBox bounds;
  std::unique_ptr<spm::Forest> forest;
  std::vector<spm::RegionId> here;
};

Scenery::Scenery(const std::vector<StandingObject>& objects, std::uint32_t slots)
    : pool_{pool_for(objects, slots)}, nodes_{pool_.settings.tree_nodes}, cache_{pool_} {
  const auto wide = [](const std::array<float, 3>& p) { return Vec3d{p[0], p[1], p[2]}; };
  for (const StandingObject& standing : objects) {
    if (objects_.size() == spm::kMaxObjects) break;
    const spm::BaseMesh& base = standing.model->base();
    spm::Cache::Admitted admitted = cache_.admit(base);
    if (!admitted.fits) continue;
    auto& object = *objects_.emplace_back(std::make_unique<Object>());
    object.model = standing.model;
    object.placement = sharing::Placement{standing.pose, standing.scale};
    object.bounds = {wide(base.summary.bounds_min), wide(base.summary.bounds_max)};
    object.forest =
        std::make_unique<spm::Forest>(pool_, nodes_, spm::index(admitted.object), base.summary,
                                      spm::RegionGrid{base.summary.grid, base.regions}, std::move(admitted.base));
    spm::Budget budget = kAll;
    (void)object.forest->advance(budget);
    (void)object.forest->refit();
    scene_.add({&object.forest->tree(), &object.placement, spm::index(admitted.object)});
  }
}
Scenery::~Scenery() = default;

bool Scenery::load(Object& object, spm::RegionId region) {
  const auto place =
      std::find_if(objects_.begin(), objects_.end(), [&](const auto& one) { return one.get() == &object; });
  const spm::ObjectIndex index{static_cast<std::uint32_t>(place - objects_.begin())};
  std::vector<spm::Run> missing;
  for (const spm::Run& run : object.model->runs_of(region))
    for (std::uint32_t record = run.first; record < run.first + run.count; ++record) {
      if (cache_.has(index, record)) continue;
      if (!missing.empty() && missing.back().first + missing.back().count == record)
        ++missing.back().count;
      else
        missing.push_back({record, 1});
    }
  const spm::codec::Bytes message = spm::codec::encode_region(*object.model, region, missing);
  const auto decoded = spm::codec::decode_region(message, object.model->summary(), object.model->tables());
  spm::RegionList list;
  if (!decoded || cache_.accept(index, *decoded, list) != spm::AcceptResult::kAccepted) return false;
  object.forest->add(region, list);
  object.here.push_back(region);
  ++regions_loaded_;
  return true;
}

/// Of everything but what is wanted now.
void Scenery::give_back(const std::vector<std::vector<spm::RegionId>>& wanted) {
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    Object& object = *objects_[i];
    for (const spm::RegionId region : object.here)
      if (!std::binary_search(wanted[i].begin(), wanted[i].end(), region)) object.forest->retire(region);
    spm::Budget budget = kAll;
    (void)object.forest->advance(budget);
    (void)object.forest->refit();
    for (std::uint32_t region; (region = object.forest->take_retired()) != spm::kNone;) {
      cache_.release(spm::ObjectIndex{static_cast<std::uint32_t>(i)}, spm::RegionId{region});
      object.here.erase(std::remove(object.here.begin(), object.here.end(), spm::RegionId{region}), object.here.end());
    }
  }
}

void Scenery::look(const std::vector<Vec3d>& places) {
  std::vector<std::vector<spm::RegionId>> wanted(objects_.size());
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    const Object& object = *objects_[i];
    for (const Vec3d& place : places) {
      if (!sharing::near_bounds(object.placement, object.bounds, place, kAround)) continue;
      object.forest->grid().for_each_meeting(object.placement.to_model(place), kAround / object.placement.scale(),
                                             [&](spm::RegionId region, double) { wanted[i].push_back(region); });
    }
    std::sort(wanted[i].begin(), wanted[i].end());
    wanted[i].erase(std::unique(wanted[i].begin(), wanted[i].end()), wanted[i].end());
  }
  int loaded = 0;
  bool full = false;
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    Object& object = *objects_[i];
    for (const spm::RegionId region : wanted[i]) {
      if (full || loaded == kMostNew) break;
      if (object.forest->is_here(region)) continue;
      full = !load(object, region);
      ++loaded;
    }
  }
  if (full) give_back(wanted);  // there is room at the next look
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    Object& object = *objects_[i];
    if (wanted[i].empty()) continue;
    object.forest->target(wanted[i].data(), static_cast<std::uint32_t>(wanted[i].size()), spm::Unasked::kRest);
    spm::Budget budget = kAll;
    (void)object.forest->advance(budget);
    (void)object.forest->refit();
  }
}

bool Scenery::exact(const Vec3d& centre, double radius) const {
  return std::all_of(objects_.begin(), objects_.end(), [&](const auto& object) {
    const sharing::Placement& placement = object->placement;
    return object->forest->exact(placement.to_model(centre), radius / placement.scale());
  });
}

}  // namespace tactus::host_service
