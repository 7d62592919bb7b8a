/// An HRTC's run time along a path, without network or threads: what the benchmarks of the cycle, of queries and
/// of the paper's tables have in common.
///
/// spm::LocalRefinement with regions that come through the codec as they would from a host, outside what is timed, and
/// a pool of a share of the model. File units, model frame.
#pragma once

#include <cstdint>

#include "bench/priority.hpp"
#include "spm/codec/compressed_source.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/local_refinement.hpp"
#include "spm/model.hpp"

namespace tactus::bench {

constexpr double kPeriod = 0.001;  ///< s, of the cycle

struct RefinedRunSettings {
  double speed = 0;  ///< units/s; what a tip at rest is expected to start with
  double pool_share = 0.25;
  std::uint32_t budget = 1000;  ///< of a cycle, units of spm::Budget
};

/// What one cycle did before its query.
struct RefinedStep {
  double refine = 0, refit = 0;  ///< us; refine: with the selection of targets
  ThreadUse before;              ///< after loading, which is not the cycle's
  std::uint64_t visits = 0;      ///< list entries looked at
  std::uint64_t changes = 0;     ///< records split or collapsed
};

class RefinedRun {
 public:
  /// `model` must outlive it. Shows the base mesh. `probe`: what is to be exact. Throws std::runtime_error when the
  /// base mesh does not fit the pool.
  RefinedRun(const spm::Model& model, const spm::ProbeShape& probe, const RefinedRunSettings& settings);

  /// One cycle up to its query. `in_contact`: what the query before found.
  RefinedStep step(const Eigen::Isometry3d& pose, bool in_contact);
  RefinedStep step(const spm::Vec3d& tip, bool in_contact) {
    return step(Eigen::Isometry3d{Eigen::Translation3d{tip}}, in_contact);
  }

  /// The first regions have had time to come.
  [[nodiscard]] bool settled() const noexcept;
  [[nodiscard]] const spm::LocalRefinement& refinement() const noexcept { return refinement_; }
  [[nodiscard]] const spm::Forest& forest() const noexcept { return refinement_.forest(); }
  [[nodiscard]] std::uint64_t evictions() const noexcept { return refinement_.evictions(); }

 private:
  spm::codec::EncodedModel encoded_;
  spm::codec::CompressedSource source_;
  RefinedRunSettings settings_;
  spm::LocalRefinement refinement_;
  std::uint64_t cycle_ = 0;  // those begun
};

}  // namespace tactus::bench
