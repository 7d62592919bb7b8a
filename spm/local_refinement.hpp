/// Local refinement of a model for a program without a session: one probe, one thread, memory fixed at the start.
///
///   RegionSource -> [approach: load what the probe is about to meet] -> [refine within a budget] -> queries
///
/// In each frame `approach` says where the probe is, `refine` makes the mesh finest there, as far as the budget goes,
/// and queries find contacts; `exact` says whether these are those of the finest mesh. An HRTC's cycle does the same
/// with the same target selection and test (spm/target_selection.hpp), but its loader has a thread of its own.
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

/// Where a model comes from. spm/codec/compressed_source.hpp is one over an .spm file or bytes in memory.
class RegionSource {
 public:
  virtual ~RegionSource() = default;
  [[nodiscard]] virtual const BaseMesh& base() const = 0;
  /// With all its records. Throws when there is no such region, which ends `approach`.
  [[nodiscard]] virtual RegionData region(RegionId region) = 0;
};

struct LocalRefinementSettings {
  std::uint64_t memory = 64u << 20;  ///< bytes; for the mesh and the model's directory
  TargetMargins margins;
  double look_ahead = 0.01;      ///< s; the probe's motion so far ahead is refined for
  double load_ahead = 0.2;       ///< s; and loaded for
  double min_speed = 0;          ///< file units/s; with which a probe at rest is expected to start
  std::uint32_t targets = 1024;  ///< regions that are refined at a time; the least urgent of more stay coarse
  Strategy strategy = Strategy::kMixture;
};

class LocalRefinement {
 public:
  /// Loads and shows the base mesh. `probe` in file units; `source` must outlive this. Allocates. Throws
  /// std::runtime_error when the base mesh does not fit into the memory.
  LocalRefinement(RegionSource& source, ProbeShape probe, const LocalRefinementSettings& settings = {});
  LocalRefinement(const LocalRefinement&) = delete;
  LocalRefinement& operator=(const LocalRefinement&) = delete;

  /// The probe is at `pose` at `time`, s; times ascend. Loads the regions that it is about to meet and frees those that
  /// it met longest ago. `in_contact`: what the query before found; says which motion to expect. Allocates.
  void approach(const Eigen::Isometry3d& pose, double time, bool in_contact = false);

  /// Refines where the probe is and is about to be, coarsens elsewhere, and refits the tree. kBudget: there is more to
  /// do. Realtime.
  Advance refine(Budget budget) noexcept {
    select_targets();
    const Advance result = advance(budget);
    refit();
    return result;
  }
  // The same in its three steps, for who times them.
  void select_targets() noexcept;
  Advance advance(Budget& budget) noexcept { return forest_.advance(budget); }
  RefitCount refit() noexcept { return forest_.refit(); }

  /// Queries of the probe where it last was give the contacts of the finest mesh. Realtime.
  [[nodiscard]] bool exact() const noexcept { return spm::exact(forest_, placed_); }

  /// Faces that a sphere touches: at most `capacity` of them in `out`. Returns how many, more than `capacity` when
  /// there are more. While `exact`, without coarse faces, which belong to other cells then. Realtime.
  std::uint32_t touching(const Vec3d& centre, double radius, Contact* out, std::uint32_t capacity) const noexcept;
  /// The same of a mesh probe, which has been placed at the pose of `approach`.
  MeshTouch touching(PlacedProbe& probe, MeshContact* out, std::uint32_t capacity) const noexcept;

  [[nodiscard]] const Forest& forest() const noexcept { return forest_; }
  [[nodiscard]] const ProbeShape& probe() const noexcept { return probe_; }
  /// False when regions near the probe stay coarse for LocalRefinementSettings::targets.
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
  std::uint64_t frame_ = 0;               // those begun
  std::vector<std::uint64_t> wanted_in_;  // by region: frame
  std::uint64_t evictions_ = 0;
};

}  // namespace tactus::spm
