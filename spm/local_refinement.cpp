#include "spm/local_refinement.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "spm/directory.hpp"

namespace tactus::spm {
namespace {

/// Returns the settings of the largest pool that fits into `memory` bytes together with the directory. A larger pool
/// needs a larger directory, so the directory of a pool of `memory` bytes is an upper bound.
PoolSettings pool_in(std::uint64_t memory, const RegionSource& source) {
  const std::uint64_t directory =
      directory_bytes(source.base().summary, PoolSettings::for_bytes(memory), source.regions());
  return PoolSettings::for_bytes(memory > directory ? memory - directory : 0);
}

Cache::Admitted admit(Cache& cache, const BaseMesh& base, std::uint64_t memory) {
  Cache::Admitted admitted = cache.admit(base);
  if (!admitted.fits)
    throw std::runtime_error("the base mesh needs " + std::to_string(Cache::slots_for_base(base.summary)) +
                             " slots, but a pool in " + std::to_string(memory) + " bytes of memory has only " +
                             std::to_string(cache.slots_free()));
  return admitted;
}

}  // namespace

LocalRefinement::LocalRefinement(RegionSource& source, ProbeShape probe, const LocalRefinementSettings& settings)
    : source_{source},
      probe_{std::move(probe)},
      settings_{settings},
      pool_{pool_in(settings.memory, source)},
      nodes_{pool_.settings.tree_nodes},
      cache_{pool_},
      admitted_{admit(cache_, source.base(), settings.memory)},
      forest_{pool_,
              nodes_,
              admitted_.object,
              source.base().summary,
              RegionGrid{source.base().summary.grid, source.regions()},
              std::move(admitted_.base)},
      predictor_{forest_.grid(), probe_, 1, {0, settings.margins.refine, settings.min_speed, settings.strategy}},
      targets_{settings.targets},
      placed_(probe_.spheres().size()),
      last_wanted_frame_(source.regions().size(), 0) {
  Budget unlimited{~0u};
  if (forest_.advance(unlimited) != Advance::kDone)
    throw std::runtime_error("the base mesh needs more than " + std::to_string(pool_.settings.tree_nodes) +
                             " tree nodes, the limit for " + std::to_string(settings.memory) + " bytes of memory");
  forest_.refit();
}

void LocalRefinement::place_spheres(const Eigen::Isometry3d& pose, double time) {
  const std::span<const ProbeSphere> spheres = probe_.spheres();
  const double elapsed = time - time_;
  const double frames_ahead = frame_ > 0 && elapsed > 0 ? settings_.look_ahead / elapsed : 0;
  for (std::size_t i = 0; i < spheres.size(); ++i) {
    const Vec3d centre = pose * spheres[i].centre;
    placed_[i] = {centre, spheres[i].radius, frames_ahead * (centre - placed_[i].centre)};
  }
  time_ = time;
  ++frame_;
}

void LocalRefinement::approach(const Eigen::Isometry3d& pose, double time, bool in_contact) {
  place_spheres(pose, time);
  for (RegionId retired = forest_.take_retired(); retired != kNone; retired = forest_.take_retired())
    cache_.release(admitted_.object, retired);
  predictor_.observe(time, placed_, in_contact);
  predicted_.clear();
  predictor_.predict(settings_.load_ahead, predicted_);
  predicted_.sort();
  for (const PredictedRegion& predicted : predicted_.entries()) last_wanted_frame_[predicted.region] = frame_;
  for (const PredictedRegion& predicted : predicted_.entries()) {
    if (cache_.is_loaded(admitted_.object, predicted.region) || load(predicted.region)) continue;
    return evict();
  }
}

/// Loads the region. Returns false if the pool is full.
bool LocalRefinement::load(RegionId region) {
  RegionList list;
  const RegionData data = source_.region(region);
  switch (cache_.accept(admitted_.object, data, list_summary(source_.regions()[index(region)]), list)) {
    case AcceptResult::kAccepted:
      forest_.add(region, list);
      return true;
    case AcceptResult::kLoaded:
      return true;
    case AcceptResult::kPoolFull:
      return false;
    case AcceptResult::kIncomplete:
    case AcceptResult::kMalformed:
      break;
  }
  throw std::runtime_error("region " + std::to_string(index(region)) + " is incomplete or contradicts the model");
}

/// Retires the least recently wanted region. After `refine` has coarsened it, a later `approach` frees its memory.
void LocalRefinement::evict() {
  RegionId oldest = kNone;
  for (const RegionId region : last_wanted_frame_.ids()) {
    if (last_wanted_frame_[region] == frame_ || !forest_.is_loaded(region) || forest_.is_retiring(region)) continue;
    if (oldest == kNone || last_wanted_frame_[region] < last_wanted_frame_[oldest]) oldest = region;
  }
  if (oldest == kNone) return;
  forest_.retire(oldest);
  ++evictions_;
}

void LocalRefinement::select_targets() noexcept {
  targets_.begin(forest_, settings_.margins);
  for (const PlacedSphere& sphere : placed_) targets_.add_sphere(sphere);
  const std::span<const RegionId> targets = targets_.finish();
  forest_.set_targets(targets.data(), static_cast<std::uint32_t>(targets.size()), Unrequested::kRetain);
}

std::uint32_t LocalRefinement::find_contacts(const Vec3d& centre, double radius, Contact* out,
                                             std::uint32_t capacity) const noexcept {
  const std::uint32_t found = forest_.tree().find_contacts(centre, radius, out, capacity);
  if (found > capacity || !forest_.is_exact(centre, radius)) return found;
  return static_cast<std::uint32_t>(std::remove_if(out, out + found, [](const Contact& c) { return !c.is_finest(); }) -
                                    out);
}

MeshQueryResult LocalRefinement::find_contacts(PlacedProbe& probe, MeshContact* out,
                                               std::uint32_t capacity) const noexcept {
  MeshQueryResult touch = probe.find_contacts(forest_.tree(), out, capacity);
  if (touch.contacts > capacity || !touch.complete || !is_exact()) return touch;
  MeshContact* const end = std::remove_if(out, out + touch.contacts, [](const MeshContact& c) { return !c.is_finest; });
  touch.contacts = static_cast<std::uint32_t>(end - out);
  return touch;
}

}  // namespace tactus::spm
