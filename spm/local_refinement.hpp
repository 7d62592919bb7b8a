/// Local refinement of a model for a program without a session: one probe, one thread, memory fixed at the start.
///
///   RegionSource -> [approach: load the regions that the probe will touch] -> [refine within a budget] -> queries
///
/// In each frame, call `approach` with the pose of the probe, then `refine`, which refines the mesh near the probe as
/// far as the budget allows, then a query. `exact` shows whether the contacts are those of the finest mesh. The cycle
/// of an HRTC uses the same target selection and the same test (spm/target_selection.hpp), but loads in another thread.
///
/// Model frame, file units. Source: Liu, Georganas, Roth, 3DIM 2005, sections 3 and 4.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <vector>

#include "spm/cache.hpp"
#include "spm/forest.hpp"
#include "spm/mesh_probe.hpp"
#include "spm/prediction.hpp"
#include "spm/probe_spheres.hpp"
#include "spm/region_data.hpp"
#include "spm/target_selection.hpp"

namespace tactus::spm {

/// Source of a model's regions. spm/codec/compressed_source.hpp implements it for .spm files and bytes in memory.
class RegionSource {
 public:
  virtual ~RegionSource() = default;
  [[nodiscard]] virtual const BaseMesh& base() const = 0;
  /// The region with all its records. Throws if there is no such region; `approach` passes the exception on.
  [[nodiscard]] virtual RegionData region(RegionId region) = 0;
};

struct LocalRefinementSettings {
  std::uint64_t memory = 64u << 20;  ///< bytes; for the mesh and the model's directory
  TargetMargins margins;
  double look_ahead = 0.01;      ///< s; refines for the motion of the probe during this time
  double load_ahead = 0.2;       ///< s; loads for the motion of the probe during this time
  double min_speed = 0;          ///< file units/s; expected when a probe at rest starts
  std::uint32_t targets = 1024;  ///< max regions refined at a time; if there are more, the least urgent stay coarse
  Strategy strategy = Strategy::kMixture;
};

class LocalRefinement {
 public:
  /// Loads and shows the base mesh. `probe` in file units; `source` must outlive this. Allocates. Throws
  /// std::runtime_error if the base mesh does not fit into the memory.
  LocalRefinement(RegionSource& source, ProbeShape probe, const LocalRefinementSettings& settings = {});
  LocalRefinement(const LocalRefinement&) = delete;
  LocalRefinement& operator=(const LocalRefinement&) = delete;

  /// Sets the pose of the probe at `time`, s; times ascend. Loads the regions that the probe will touch soon and frees
  /// the least recently wanted ones. `in_contact`: the previous query found a contact; selects the prediction.
  /// Allocates.
  void approach(const Eigen::Isometry3d& pose, double time, bool in_contact = false);

  /// Refines near the probe and its predicted path, coarsens elsewhere, and refits the tree. kBudget: not finished.
  /// Realtime.
  Advance refine(Budget budget) noexcept {
    select_targets();
    const Advance result = advance(budget);
    refit();
    return result;
  }
  // The three steps of `refine`, for measurements.
  void select_targets() noexcept;
  Advance advance(Budget& budget) noexcept { return forest_.advance(budget); }
  RefitCount refit() noexcept { return forest_.refit(); }

  /// True if queries at the last pose give the contacts of the finest mesh. Realtime.
  [[nodiscard]] bool exact() const noexcept { return spm::exact(forest_, placed_); }

  /// Writes the contacts of a sphere, at most `capacity`, and returns how many there are. While `exact`, it leaves out
  /// coarse faces, which then belong to other cells. Realtime.
  std::uint32_t touching(const Vec3d& centre, double radius, Contact* out, std::uint32_t capacity) const noexcept;
  /// The contacts of a mesh probe that was placed at the pose of `approach`.
  MeshTouch touching(PlacedProbe& probe, MeshContact* out, std::uint32_t capacity) const noexcept;

  [[nodiscard]] const Forest& forest() const noexcept { return forest_; }
  [[nodiscard]] const ProbeShape& probe() const noexcept { return probe_; }
  /// False if regions near the probe stay coarse because of LocalRefinementSettings::targets.
  [[nodiscard]] bool targets_complete() const noexcept { return targets_.complete(); }
  [[nodiscard]] std::uint64_t evictions() const noexcept { return evictions_; }

 private:
  void place(const Eigen::Isometry3d& pose, double time);
  [[nodiscard]] bool load(RegionId region);
  void evict();

  RegionSource& source_;
  ProbeShape probe_;
  LocalRefinementSettings settings_;
  Pool pool_;
  NodePool nodes_;
  Cache cache_;
  Cache::Admitted admitted_;
  Forest forest_;
  ProbePredictor predictor_;
  Predictor::Answer met_;
  TargetSelection targets_;
  std::vector<PlacedSphere> placed_;
  double time_ = 0;
  std::uint64_t frame_ = 0;                      // number of the current one
  IdVector<RegionId, std::uint64_t> wanted_in_;  // frame
  std::uint64_t evictions_ = 0;
};

}  // namespace tactus::spm
