/// Selects the regions of an object to refine for the probes near it, in the order of their urgency. `is_exact` reports
/// whether a probe's contacts are those of the finest mesh.
///
/// Spheres cover the surface of each probe (spm/probe_spheres.hpp). If a sphere intersects a labelled cell, the mesh
/// must have full resolution in the cell. The order has three groups of regions:
///   1. regions that a sphere intersects now,
///   2. regions that a sphere will soon intersect,
///   3. refined regions near a sphere, so that a small movement causes no splits and collapses.
/// Within a group, the nearest region comes first.
///
/// Model frame, file units. Fixed memory. Realtime after construction.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (contact regions and their refinement).
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <tuple>
#include <vector>

#include "spm/forest.hpp"
#include "spm/probe_spheres.hpp"
#include "spm/region_table.hpp"

namespace tactus::spm {

/// File units.
struct TargetMargins {
  double refine = 0;  ///< regions within this distance of a sphere are in the second group
  double retain = 0;  ///< refined regions within this distance of a sphere are in the third group
};

class TargetSelection {
 public:
  /// `capacity` is the max number of selected regions. If there are more, the least urgent are dropped. Allocates.
  explicit TargetSelection(std::uint32_t capacity) : targets_{capacity}, order_(std::max(capacity, 1u)) {}

  /// Starts a selection among the loaded regions of `forest`. Do not change `forest` before `finish`.
  void begin(const Forest& forest, const TargetMargins& margins) noexcept;

  /// Adds the regions near a sphere of a probe. One query of the grid.
  void add_sphere(const PlacedSphere& sphere) noexcept;
  /// Adds the regions that a given sphere intersects to the second group.
  void add_soon(const Vec3d& centre, double radius) noexcept;

  /// Returns the selected regions in their order, for Forest::set_targets. Valid until the next `begin`.
  [[nodiscard]] std::span<const RegionId> finish() noexcept;
  /// False if regions were dropped, or a sphere was too large for a query of the grid.
  [[nodiscard]] bool complete() const noexcept { return targets_.complete(); }

 private:
  enum class Group : std::uint8_t { kNow, kSoon, kRefined, kNotWanted };
  struct Target {
    RegionId region{};
    Group group = Group::kNotWanted;
    double squared_distance = 0;  ///< from the sphere that the group compares with the region
    [[nodiscard]] bool precedes(const Target& other) const noexcept {
      return std::tie(group, squared_distance, region) < std::tie(other.group, other.squared_distance, other.region);
    }
    void merge(const Target& other) noexcept {
      if (other.precedes(*this)) *this = other;
    }
  };
  template <class Classify>
  void add_within(const Vec3d& centre, double radius, Classify classify) noexcept;

  const Forest* forest_ = nullptr;
  TargetMargins margins_;
  RegionTable<Target> targets_;
  std::vector<RegionId> order_;
};

/// True if every labelled cell that the spheres intersect is refined. Queries within the spheres then return the
/// contacts of the finest mesh. The caller must ignore contacts with faces that are not finest, which belong to other
/// cells.
[[nodiscard]] bool is_exact(const Forest& forest, std::span<const PlacedSphere> spheres) noexcept;

}  // namespace tactus::spm
