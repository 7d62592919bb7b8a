#include "host_service/scenery.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "spm/codec/load_region.hpp"
#include "spm/directory.hpp"

namespace tactus::host_service {

namespace {

using haptics::Vec3d;

constexpr double kRefineRadius = sharing::kBodySearchDistance;  // m, radius around a contact that is refined
constexpr int kMaxNew = 8;                                      // max regions decoded in one call of `refine_around`

/// Returns the settings of a pool that holds the base meshes, and besides them `slots` slots for regions.
spm::PoolSettings pool_for(const std::vector<StaticObject>& objects, std::uint32_t slots) {
  std::uint32_t base_slots = 0, base_nodes = 0;
  for (const StaticObject& object : objects) {
    const spm::BaseMesh& base = object.model->base();
    base_slots += spm::Cache::slots_for_base(base.summary);
    base_nodes += spm::tree_nodes_above(base.faces, base.summary.faces);
  }
  spm::PoolSettings settings = spm::PoolSettings::for_slots(slots);
  settings.slots += base_slots;
  settings.tree_nodes += base_nodes;
  return settings;
}

/// Refines with a budget that is large enough for any refinement, because no haptic cycle waits for the result.
void refine(spm::Forest& forest) {
  spm::Budget budget{1u << 22};
  (void)forest.advance(budget);
  (void)forest.refit();
}

}  // namespace

struct Scenery::Object {
  const spm::codec::CompressedModel* model;
  spm::ObjectIndex index;
  sharing::Placement placement;
  spm::CellBox bounds;
  std::unique_ptr<spm::Forest> forest;
  std::vector<spm::RegionId> loaded_regions;
  std::set<spm::RegionId> damaged_regions;  // found so far
};

Scenery::Scenery(const std::vector<StaticObject>& objects, std::uint32_t slots)
    : pool_{pool_for(objects, slots)}, nodes_{pool_.settings.tree_nodes}, cache_{pool_} {
  for (const StaticObject& source : objects) {
    if (objects_.size() == spm::kMaxObjects) break;
    const spm::BaseMesh& base = source.model->base();
    spm::Cache::Admitted admitted = cache_.admit(base);
    if (!admitted.fits) continue;
    auto& object = *objects_.emplace_back(std::make_unique<Object>());
    object.model = source.model;
    object.index = admitted.object;
    object.placement = sharing::Placement{source.pose, source.scale};
    object.bounds = spm::bounds_of(base.summary);
    object.forest = std::make_unique<spm::Forest>(pool_, nodes_, admitted.object, base.summary,
                                                  spm::RegionGrid{base.summary.grid, source.model->regions()},
                                                  std::move(admitted.base));
    refine(*object.forest);
    scene_.add({&object.forest->tree(), &object.placement, spm::index(admitted.object)});
  }
}
Scenery::~Scenery() = default;

spm::AcceptResult Scenery::load(Object& object, spm::RegionId region) {
  spm::RegionList list;
  const spm::AcceptResult result = spm::codec::load_region(*object.model, region, cache_, object.index, list);
  if (result != spm::AcceptResult::kAccepted) return result;
  object.forest->add(region, list);
  object.loaded_regions.push_back(region);
  ++regions_loaded_;
  return result;
}

/// Releases every region that is not in `wanted`.
void Scenery::release_unwanted(const std::vector<std::vector<spm::RegionId>>& wanted) {
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    Object& object = *objects_[i];
    for (const spm::RegionId region : object.loaded_regions)
      if (!std::binary_search(wanted[i].begin(), wanted[i].end(), region)) object.forest->retire(region);
    refine(*object.forest);
    for (spm::RegionId region; (region = object.forest->take_retired()) != spm::kNone;) {
      cache_.release(object.index, region);
      object.loaded_regions.erase(std::remove(object.loaded_regions.begin(), object.loaded_regions.end(), region),
                                  object.loaded_regions.end());
    }
  }
}

void Scenery::refine_around(const std::vector<Vec3d>& points) {
  std::vector<std::vector<spm::RegionId>> wanted(objects_.size());
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    const Object& object = *objects_[i];
    for (const Vec3d& point : points) {
      if (!sharing::overlaps_bounds(object.placement, object.bounds, point, kRefineRadius)) continue;
      object.forest->grid().for_each_intersecting(object.placement.to_model(point),
                                                  kRefineRadius / object.placement.scale(),
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
      if (full || loaded == kMaxNew) break;
      if (object.forest->is_loaded(region) || object.damaged_regions.count(region) != 0) continue;
      const spm::AcceptResult result = load(object, region);
      if (result == spm::AcceptResult::kMalformed) {  // stays coarse
        object.damaged_regions.insert(region);
        ++regions_damaged_;
      }
      full = result == spm::AcceptResult::kPoolFull;
      ++loaded;
    }
  }
  if (full) release_unwanted(wanted);  // frees slots for the next call
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    Object& object = *objects_[i];
    if (wanted[i].empty()) continue;
    object.forest->set_targets(wanted[i].data(), static_cast<std::uint32_t>(wanted[i].size()),
                               spm::Unrequested::kRetain);
    refine(*object.forest);
  }
}

bool Scenery::is_exact(const Vec3d& centre, double radius) const {
  return std::all_of(objects_.begin(), objects_.end(), [&](const auto& object) {
    const sharing::Placement& placement = object->placement;
    return object->forest->is_exact(placement.to_model(centre), radius / placement.scale());
  });
}

}  // namespace tactus::host_service
