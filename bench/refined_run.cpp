#include "bench/refined_run.hpp"

#include <algorithm>

#include "bench/stopwatch.hpp"
#include "spm/directory.hpp"

namespace tactus::bench {

namespace {

// Distances from the probe, m, as in hrtc_service/servo/cycle.hpp: regions are refined within kRefineMargin, and coarsened
// beyond kRetainMargin.
constexpr double kRetainMargin = 0.002;
constexpr double kRefineMargin = 0.0005;

spm::LocalRefinementSettings settings_of(const spm::ModelSummary& summary, const RefinedRunSettings& settings) {
  // If a model is hardly larger than the tip, the tip touches most of the model at once. A share of such a small model
  // would then be too few slots, so the pool has at least this number in addition to the slots of the base mesh.
  constexpr std::uint32_t kMinSlots = 8192;
  const std::uint32_t base_slots = std::max(summary.base_vertices, (summary.base_faces + 1) / 2);
  const auto share_slots = static_cast<std::uint32_t>(settings.pool_share * summary.parts);
  const spm::PoolSettings pool = spm::PoolSettings::for_slots(base_slots + std::max(share_slots, kMinSlots));
  spm::LocalRefinementSettings refinement;
  refinement.memory = pool.bytes() + spm::directory_bytes(summary, pool);
  refinement.margins = {kRefineMargin / summary.metres_per_unit, kRetainMargin / summary.metres_per_unit};
  refinement.min_speed = settings.speed;
  return refinement;
}

}  // namespace

RefinedRun::RefinedRun(const spm::Model& model, const spm::ProbeShape& probe, const RefinedRunSettings& settings)
    : encoded_{model},
      source_{encoded_.compressed()},
      settings_{settings},
      refinement_{source_, probe, settings_of(model.summary, settings)} {}

RefinedStep RefinedRun::step(const Eigen::Isometry3d& pose, bool in_contact) {
  refinement_.approach(pose, static_cast<double>(cycles_++) * kPeriod, in_contact);
  RefinedStep step;
  const spm::ForestCounters before = forest().counters();
  spm::Budget budget{settings_.budget};
  step.before = thread_use();
  Stopwatch watch;
  refinement_.select_targets();
  static_cast<void>(refinement_.advance(budget));
  step.refine = watch.lap();
  refinement_.refit();
  step.refit = watch.lap();
  const spm::ForestCounters& after = forest().counters();
  step.visits = after.visits - before.visits;
  step.changes = after.splits - before.splits + after.collapses - before.collapses;
  return step;
}

bool RefinedRun::settled() const noexcept {
  return cycles_ > static_cast<std::uint64_t>(spm::LocalRefinementSettings{}.load_ahead / kPeriod);
}

}  // namespace tactus::bench
