/// Runs the loading and refinement of an HRTC along a path, without network or threads, for the benchmarks of the
/// cycle, of queries and of the paper's tables.
///
/// Regions are encoded and decoded as between host and HRTC; this is not timed. The pool holds a share of the model.
/// File units, model frame.
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
  double speed = 0;             ///< min speed that the prediction assumes, units/s
  double pool_share = 0.25;     ///< pool slots beyond the base mesh divided by the model's record parts
  std::uint32_t budget = 1000;  ///< of a cycle, units of spm::Budget
};

/// Times and counts of one cycle before its query.
struct RefinedStep {
  double refine = 0, refit = 0;  ///< us; refine includes the selection of targets
  ThreadUse before;              ///< resources of the thread when the timed part starts, after loading
  std::uint64_t visits = 0;      ///< number of list entries visited
  std::uint64_t changes = 0;     ///< number of records split or collapsed
};

class RefinedRun {
 public:
  /// Shows the base mesh. Contacts of `probe` become exact by refinement. `model` must outlive this object. Throws
  /// std::runtime_error if the base mesh does not fit the pool.
  RefinedRun(const spm::Model& model, const spm::ProbeShape& probe, const RefinedRunSettings& settings);

  /// Runs one cycle up to its query. `in_contact`: whether the previous query found a contact.
  RefinedStep step(const Eigen::Isometry3d& pose, bool in_contact);
  RefinedStep step(const spm::Vec3d& tip, bool in_contact) {
    return step(Eigen::Isometry3d{Eigen::Translation3d{tip}}, in_contact);
  }

  /// Returns true once the prediction has looked ahead long enough for the first regions to be loaded.
  [[nodiscard]] bool settled() const noexcept;
  [[nodiscard]] const spm::LocalRefinement& refinement() const noexcept { return refinement_; }
  [[nodiscard]] const spm::Forest& forest() const noexcept { return refinement_.forest(); }
  [[nodiscard]] std::uint64_t evictions() const noexcept { return refinement_.evictions(); }

 private:
  spm::codec::EncodedModel encoded_;
  spm::codec::CompressedSource source_;
  RefinedRunSettings settings_;
  spm::LocalRefinement refinement_;
  std::uint64_t cycles_ = 0;  // number of cycles begun
};

}  // namespace tactus::bench
