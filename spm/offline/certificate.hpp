/// The maximum that one probe can ever need of a model, computed before a session.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "spm/model.hpp"

namespace tactus::spm::offline {

/// Upper bounds over all positions and straight motions of a sphere. Space is divided into cubes of edge `step`. For
/// each cube, `certify` counts the regions whose occupied parts the sphere can intersect while its centre is in the
/// cube. The work bounds assume that these regions are refined and that they change when the centre enters the next
/// cube.
struct Certificate {
  double radius, speed;  ///< of the sphere, file units and file units/s

  std::uint32_t regions;        ///< labelled cells of one cube
  std::uint32_t records;        ///< in the union of their lists
  std::uint32_t parts;          ///< pool slots of these records, without the base mesh
  std::uint32_t blocks;         ///< list blocks of these regions
  std::uint32_t nodes;          ///< tree nodes above them and the base mesh; an upper bound for a query
  std::array<double, 3> worst;  ///< the position with the most parts, model frame

  double step;                                 ///< file units
  std::uint32_t entering;                      ///< records that a cube needs and the previous cube does not
  std::uint32_t units;                         ///< of Budget (spm/forest.hpp) for a step from one cube to the next
  std::uint32_t faces;                         ///< max faces that such a step adds, removes or deforms
  std::vector<RegionId> units_from, units_to;  ///< regions before and after the step with the most units
  /// The messages of a host for the step with the most entering records: regions, each with its missing records.
  struct Bringing {
    RegionId region;
    std::vector<Interval> missing;
  };
  std::vector<Bringing> brings;
  /// The maximum number of cubes that a straight motion enters in a second.
  [[nodiscard]] double steps_per_second() const noexcept { return std::sqrt(3.0) * speed / step; }
};

/// `model` must be sound. Some seconds for 10^5 regions. Allocates.
[[nodiscard]] Certificate certify(const Model& model, double radius, double speed);

/// The slots of a pool for the base mesh and the parts of the worst cube.
[[nodiscard]] std::uint32_t slots_needed(const ModelSummary& summary, const Certificate& certificate) noexcept;
/// The minimum memory for models (shares_of in spm/directory.hpp) of an HRTC with this object alone.
[[nodiscard]] std::uint64_t memory_needed(const ModelSummary& summary, const Certificate& certificate) noexcept;

/// The maximum number of nodes that AbTree::refit recomputes for `faces` changed faces.
[[nodiscard]] std::uint64_t max_marked(std::uint64_t faces, std::uint64_t finest_faces);

/// Levels and inner nodes of a tree over the faces in which a node has `width` children.
struct TreeSize {
  std::uint32_t levels;
  std::uint64_t nodes;
};
[[nodiscard]] TreeSize tree_size(std::uint64_t leaves, std::uint32_t width);

}  // namespace tactus::spm::offline
