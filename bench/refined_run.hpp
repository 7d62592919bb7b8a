/// A controller's run time along a path, without network or threads: what the benchmarks of the cycle, of queries and
/// of the paper's tables have in common.
///
/// Regions come through the codec as they would from a host, outside what is timed, into a pool of a share of the
/// model; the one wanted longest ago makes room. File units, model frame.
#pragma once

#include <cstdint>
#include <vector>

#include "bench/priority.hpp"
#include "spm/cache.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/forest.hpp"
#include "spm/model.hpp"
#include "spm/prediction.hpp"

namespace tactus::bench {

constexpr double kPeriod = 0.001;  ///< s, of the cycle

struct RefinedRunSettings {
  double radius = 0;  ///< of the ball about the tip that is to be exact
  double speed = 0;   ///< units/s; what a tip at rest is expected to start with
  double pool_share = 0.25;
  std::uint32_t budget = 1000;  ///< of a cycle, units of spm::Budget
};

/// What one cycle did before its query.
struct RefinedStep {
  double refine = 0, refit = 0;  ///< us
  ThreadUse before;              ///< after planning and loading, which are not the cycle's
  std::uint64_t visits = 0;      ///< list entries looked at
  std::uint64_t changes = 0;     ///< records split or collapsed
};

class RefinedRun {
 public:
  /// `model` must outlive it. Shows the base mesh. Throws std::runtime_error when that does not fit the pool.
  RefinedRun(const spm::Model& model, const RefinedRunSettings& settings);
  RefinedRun(const RefinedRun&) = delete;
  RefinedRun& operator=(const RefinedRun&) = delete;

  /// One cycle up to its query; every fourth plans what to load and refine. `in_contact`: what the query before found.
  RefinedStep step(const spm::Vec3d& tip, bool in_contact);

  /// The first regions have had time to come.
  [[nodiscard]] bool settled() const noexcept;
  [[nodiscard]] const spm::Forest& forest() const noexcept { return forest_; }
  [[nodiscard]] std::uint64_t evictions() const noexcept { return evictions_; }

 private:
  void load(const spm::Predictor::Answer& wanted);
  [[nodiscard]] bool load(spm::RegionId region);
  void evict();

  const spm::Model& model_;
  spm::codec::EncodedModel encoded_;
  RefinedRunSettings settings_;
  spm::Pool pool_;
  spm::NodePool nodes_;
  spm::Cache cache_;
  spm::BaseMesh base_mesh_;
  spm::Cache::Admitted admitted_;
  spm::Forest forest_;
  spm::Predictor predictor_;
  spm::Predictor::Answer wanted_;
  std::vector<spm::RegionId> target_;
  std::vector<std::uint64_t> wanted_at_;  // by region: cycle
  std::uint64_t cycle_ = 0;               // those begun
  std::uint64_t evictions_ = 0;
};

}  // namespace tactus::bench
