#include "bench/refined_run.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "bench/stopwatch.hpp"
#include "spm/codec/region_codec.hpp"

namespace tactus::bench {

namespace {

constexpr std::uint32_t kPlanEvery = 4;  // cycles
constexpr double kLoadLead = 0.2;        // s
constexpr double kRefineLead = 0.05;     // s
constexpr double kKeepMargin = 0.002;    // m; as in a controller, what was refined stays until the tip is this far
constexpr double kMargin = 0.0005;       // m

std::uint32_t slots_for(const spm::ModelSummary& summary, double share) {
  // A tip as large as a small model meets most of it at once, whatever the share.
  constexpr std::uint32_t kMinSlots = 8192;
  const std::uint32_t base = std::max(summary.base_vertices, (summary.base_faces + 1) / 2);
  return base + std::max(static_cast<std::uint32_t>(share * summary.parts), kMinSlots);
}

spm::Cache::Admitted admit(spm::Cache& cache, const spm::BaseMesh& base, std::uint32_t slots) {
  spm::Cache::Admitted admitted = cache.admit(base);
  if (!admitted.fits)
    throw std::runtime_error("the base mesh does not fit a pool of " + std::to_string(slots) + " slots");
  return admitted;
}

}  // namespace

RefinedRun::RefinedRun(const spm::Model& model, const RefinedRunSettings& settings)
    : model_{model},
      encoded_{model},
      settings_{settings},
      pool_{spm::PoolSettings::for_slots(slots_for(model.summary, settings.pool_share))},
      nodes_{pool_.settings.tree_nodes},
      cache_{pool_},
      base_mesh_{spm::base_mesh_of(model)},
      admitted_{admit(cache_, base_mesh_, pool_.settings.slots)},
      forest_{pool_,
              nodes_,
              index(admitted_.object),
              model.summary,
              spm::RegionGrid{model.summary.grid, base_mesh_.regions},
              std::move(admitted_.base)},
      predictor_{forest_.grid(), {settings.radius, kMargin / model.summary.metres_per_unit, settings.speed}},
      wanted_at_(model.regions.size(), 0) {
  spm::Budget start{~0u};
  if (forest_.advance(start) != spm::Advance::kDone)
    throw std::runtime_error("the base mesh does not fit the tree nodes");
  forest_.refit();
}

RefinedStep RefinedRun::step(const spm::Vec3d& tip, bool in_contact) {
  RefinedStep step;
  Stopwatch watch;
  predictor_.observe(static_cast<double>(cycle_) * kPeriod, tip, in_contact);
  const bool plan = cycle_++ % kPlanEvery == 0;
  if (plan) {
    wanted_.clear();
    predictor_.predict(kLoadLead, wanted_);
    wanted_.sort();
    load(wanted_);
    target_.clear();
    for (const spm::PredictedRegion& wanted : wanted_.entries()) {
      // What is beside the expected way is loaded, but not refined.
      if (wanted.contact_in <= kRefineLead && wanted.doubt <= 0) target_.push_back(wanted.region);
    }
    forest_.grid().for_each_meeting(tip, settings_.radius + kKeepMargin / model_.summary.metres_per_unit,
                                    [&](spm::RegionId region, double) {
                                      if (forest_.is_refined(region)) target_.push_back(region);
                                    });
  }

  const spm::ForestCounters before = forest_.counters();
  spm::Budget budget{settings_.budget};
  step.before = thread_use();
  (void)watch.lap();
  if (plan) forest_.target(target_.data(), static_cast<std::uint32_t>(target_.size()), spm::Unrequested::kRest);
  static_cast<void>(forest_.advance(budget));
  step.refine = watch.lap();
  forest_.refit();
  step.refit = watch.lap();
  const spm::ForestCounters& after = forest_.counters();
  step.visits = after.visits - before.visits;
  step.changes = after.splits - before.splits + after.collapses - before.collapses;
  return step;
}

bool RefinedRun::settled() const noexcept { return cycle_ > static_cast<std::uint64_t>(kLoadLead / kPeriod); }

void RefinedRun::load(const spm::Predictor::Answer& wanted) {
  for (std::uint32_t gone = forest_.take_retired(); gone != spm::kNone; gone = forest_.take_retired()) {
    cache_.release(admitted_.object, spm::RegionId{gone});
  }
  for (const spm::PredictedRegion& soon : wanted.entries()) wanted_at_[index(soon.region)] = cycle_;
  for (const spm::PredictedRegion& soon : wanted.entries()) {
    const spm::RegionId region = soon.region;
    if (cache_.holds(admitted_.object, region) || load(region)) continue;
    evict();
    return;
  }
}

bool RefinedRun::load(spm::RegionId region) {
  const auto data =
      spm::codec::decode_region(spm::codec::encode_region(encoded_.coded(), region, model_.intervals_of(region)),
                                model_.summary, encoded_.coded().tables());
  if (!data) throw std::runtime_error("region " + std::to_string(index(region)) + ": " + data.error().text);
  spm::RegionList list;
  const spm::AcceptResult result = cache_.accept(admitted_.object, *data, list);
  if (result == spm::AcceptResult::kPoolFull) return false;
  if (result != spm::AcceptResult::kAccepted) {
    throw std::runtime_error("region " + std::to_string(index(region)) +
                             " was not accepted: " + std::to_string(static_cast<int>(result)));
  }
  forest_.add(region, list);
  return true;
}

void RefinedRun::evict() {
  std::uint32_t oldest = spm::kNone;
  for (std::uint32_t r = 0; r < wanted_at_.size(); ++r) {
    const spm::RegionId region{r};
    if (wanted_at_[r] == cycle_ || !forest_.is_here(region) || forest_.is_retiring(region)) continue;
    if (oldest == spm::kNone || wanted_at_[r] < wanted_at_[oldest]) oldest = r;
  }
  if (oldest == spm::kNone) return;
  forest_.retire(spm::RegionId{oldest});
  ++evictions_;
}

}  // namespace tactus::bench
