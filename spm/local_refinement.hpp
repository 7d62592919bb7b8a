/// Local refinement of a model in a program without a session, for one probe and in one thread.
///
///   RegionSource -> [approach: load the regions that the probe will touch] -> [refine within a budget] -> queries
///
/// In each frame, call `approach` with the pose of the probe, then `refine`, then a query. `refine` refines the mesh
/// near the probe as far as the budget allows. `is_exact` reports whether the contacts are those of the finest mesh.
/// The cycle of an HRTC uses the same code (spm/target_selection.hpp), but loads regions in another thread.
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

/// The source of a model's regions. spm/codec/compressed_source.hpp implements it for .spm files and bytes in memory.
class RegionSource {
 public:
  virtual ~RegionSource() = default;
  [[nodiscard]] virtual const BaseMesh& base() const = 0;
  /// All regions of the model, without their lists.
  [[nodiscard]] virtual std::span<const Region> regions() const = 0;
  /// Returns a region with all its records. Throws if it has no such region; `approach` passes the exception on.
  [[nodiscard]] virtual RegionData region(RegionId region) = 0;
};

struct LocalRefinementSettings {
  std::uint64_t memory = 64u << 20;  ///< bytes of memory for the mesh and the model's directory
  TargetMargins margins;
  double look_ahead = 0.01;      ///< s; refines the regions that the probe will meet within this time
  double load_ahead = 0.2;       ///< s; loads the regions that the probe will meet within this time
  double min_speed = 0;          ///< speed that the prediction assumes for a slower probe, file units/s
  std::uint32_t targets = 1024;  ///< max number of target regions; if there are more, the least urgent stay coarse
  Strategy strategy = Strategy::kMixture;
};

class LocalRefinement {
 public:
  /// Loads and shows the base mesh. `probe` is in file units. `source` must outlive the object. Allocates. Throws
  /// std::runtime_error if the base mesh does not fit into the memory.
  LocalRefinement(RegionSource& source, ProbeShape probe, const LocalRefinementSettings& settings = {});
  LocalRefinement(const LocalRefinement&) = delete;
  LocalRefinement& operator=(const LocalRefinement&) = delete;

  /// Sets the pose of the probe at `time` in s; times must ascend. Loads the regions that the probe will touch soon. If
  /// a region does not fit, stops loading and retires the least recently wanted region, whose memory a later call can
  /// use. `in_contact` states whether the previous query found a contact; the prediction depends on it. Allocates.
  void approach(const Eigen::Isometry3d& pose, double time, bool in_contact = false);

  /// Refines near the probe and along its extrapolated motion, and refits the tree. Other regions stay refined until
  /// they are retired or their tree nodes are needed (Unrequested::kRetain). Returns kBudget if the budget did not
  /// suffice. Realtime.
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

  /// True if queries at the last pose return the contacts of the finest mesh. Realtime.
  [[nodiscard]] bool is_exact() const noexcept { return spm::is_exact(forest_, placed_); }

  /// Writes the contacts of a sphere, at most `capacity`, and returns the number of all contacts. If they all fit and
  /// Forest::is_exact is true for the sphere, omits contacts with coarse faces, because these faces belong to other
  /// cells. Realtime.
  std::uint32_t find_contacts(const Vec3d& centre, double radius, Contact* out, std::uint32_t capacity) const noexcept;
  /// Writes the contacts of a mesh probe in the same way. `probe` must have been placed at the pose of `approach`.
  MeshQueryResult find_contacts(PlacedProbe& probe, MeshContact* out, std::uint32_t capacity) const noexcept;

  [[nodiscard]] const Forest& forest() const noexcept { return forest_; }
  [[nodiscard]] const ProbeShape& probe() const noexcept { return probe_; }
  /// False if regions near the probe stay coarse because of LocalRefinementSettings::targets.
  [[nodiscard]] bool targets_complete() const noexcept { return targets_.complete(); }
  [[nodiscard]] std::uint64_t evictions() const noexcept { return evictions_; }

 private:
  void place_spheres(const Eigen::Isometry3d& pose, double time);
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
  Predictor::Regions predicted_;
  TargetSelection targets_;
  std::vector<PlacedSphere> placed_;
  double time_ = 0;
  std::uint64_t frame_ = 0;                              // number of the current frame
  IdVector<RegionId, std::uint64_t> last_wanted_frame_;  // number of the last frame whose prediction had the region
  std::uint64_t evictions_ = 0;
};

}  // namespace tactus::spm
