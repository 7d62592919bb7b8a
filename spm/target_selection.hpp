/// Selects the regions of an object to refine for the probes near it, in the order of their urgency. `exact` reports
/// whether a probe's contacts are those of the finest mesh.
///
/// Spheres cover the surface of each probe (spm/probe_spheres.hpp). Where a sphere meets a labelled cell, the mesh must
/// be at full resolution. The order has three groups: a sphere meets the region now; a sphere will soon meet it; the
/// region is refined and a sphere has just left it. Within a group, the nearest region comes first. The third group
/// saves splits if the sphere returns.
///
/// Model frame, file units. Fixed memory. Realtime after construction.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (contact regions and their refinement).
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "spm/forest.hpp"
#include "spm/probe_spheres.hpp"
#include "spm/region_table.hpp"

namespace tactus::spm {

/// File units.
struct TargetMargins {
  double refine = 0;  ///< regions within this distance are refined before a sphere meets them
  double keep = 0;    ///< refined regions within this distance stay refined, so that a small movement splits nothing
};

class TargetSelection {
 public:
  /// `capacity`: max regions of one object; if more are selected, the least urgent are dropped. Allocates.
  explicit TargetSelection(std::uint32_t capacity) : targets_{capacity}, order_(std::max(capacity, 1u)) {}

  /// Selects only regions that were added to `forest`. Do not change `forest` before `finish`.
  void begin(const Forest& forest, const TargetMargins& margins) noexcept;

  /// Adds a probe that is one sphere.
  void add_sphere(const PlacedSphere& sphere) noexcept;
  /// Adds a probe of several spheres. It queries the grid once for each sphere and all three groups.
  void add_spheres(std::span<const PlacedSphere> spheres) noexcept;
  /// Adds a sphere for a later query. Its regions count as regions that a sphere will soon meet.
  void add_soon(const Vec3d& centre, double radius) noexcept;

  /// Returns the regions in their order, for Forest::target. Valid until the next `begin`.
  [[nodiscard]] std::span<const RegionId> finish() noexcept;
  /// False when regions were dropped, or a sphere met more cells than a query of the grid visits.
  [[nodiscard]] bool complete() const noexcept { return targets_.complete(); }

 private:
  struct Target {
    RegionId region{};
    double key = 0;  ///< smaller is more urgent
    [[nodiscard]] bool before(const Target& other) const noexcept {
      return key != other.key ? key < other.key : index(region) < index(other.region);
    }
    void merge(const Target& other) noexcept { key = other.key < key ? other.key : key; }
  };
  template <class KeyOf>
  void look(const Vec3d& centre, double radius, KeyOf key_of) noexcept;

  const Forest* forest_ = nullptr;
  TargetMargins margins_;
  RegionTable<Target> targets_;
  std::vector<RegionId> order_;
};

/// Returns true if every labelled cell that the spheres meet is refined. Queries inside the spheres then give the
/// contacts of the finest mesh; the caller must ignore contacts with faces that are not finest, which belong to other
/// cells.
[[nodiscard]] bool exact(const Forest& forest, std::span<const PlacedSphere> spheres) noexcept;

}  // namespace tactus::spm
