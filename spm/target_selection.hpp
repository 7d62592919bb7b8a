/// Which regions of an object are refined for the probes near it, the most urgent first, and whether a probe's contacts
/// are those of the finest mesh.
///
/// A probe asks by spheres that hold its surface (spm/probe_spheres.hpp): where one of them meets a labelled cell, the
/// mesh has to be the finest one. Regions that a sphere meets now come first, then those that it is about to meet, then
/// refined ones that it has just left, which need not split again if it comes back; in each group the nearest first.
///
/// Model frame, file units. Fixed memory. Realtime after construction.
/// Source: Liu, Georganas, Roth, 3DIM 2005, section 3 (contact regions and their refinement).
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "spm/forest.hpp"
#include "spm/probe_spheres.hpp"
#include "spm/region_table.hpp"

namespace tactus::spm {

/// File units.
struct TargetMargins {
  double refine = 0;  ///< regions this near are refined although not met, so that they are ready when they are
  double keep = 0;    ///< refined regions this near stay, so that a probe that wavers does not split them in turn
};

class TargetSelection {
 public:
  /// `capacity`: regions at most, of one object; the least urgent of more are dropped. Allocates.
  explicit TargetSelection(std::uint32_t capacity) : targets_{capacity}, order_(std::max(capacity, 1u)) {}

  /// Only regions that have been added to `forest` are selected; it must stay as it is until `finish`.
  void begin(const Forest& forest, const TargetMargins& margins) noexcept;

  /// For a probe that is one sphere.
  void add_sphere(const PlacedSphere& sphere) noexcept;
  /// For a probe of several spheres. Takes one look at the grid for each, in place of three.
  void add_spheres(Span<const PlacedSphere> spheres) noexcept;
  /// For a sphere that will be asked about, as if a probe were about to meet it.
  void add_soon(const Vec3d& centre, double radius) noexcept;

  /// For Forest::target. Valid until the next `begin`.
  [[nodiscard]] Span<const RegionId> finish() noexcept;
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

/// Queries of these spheres, and of what they hold, give the contacts of the finest mesh: every labelled cell that they
/// meet is refined. Contacts with faces that are not finest belong to other cells then, and are to be left out.
[[nodiscard]] bool exact(const Forest& forest, Span<const PlacedSphere> spheres) noexcept;

}  // namespace tactus::spm
