/// What a controller can ever need of a model for one probe, known before a session starts.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "spm/model.hpp"

namespace tactus::spm::offline {

/// Upper bounds over all positions and straight motions of a ball: its centre is taken through cubes of edge `step`,
/// and in each the regions are counted whose surface (Region::occupied) the ball may meet from anywhere in the cube.
/// Work is that of a controller that keeps these refined, and changes when the centre enters the next cube.
struct Certificate {
  double radius, speed;  ///< of the ball, file units and file units/s

  std::uint32_t regions;        ///< labelled cells at once
  std::uint32_t records;        ///< in the union of their lists
  std::uint32_t parts;          ///< pool slots of these records; the base mesh comes on top
  std::uint32_t blocks;         ///< list blocks of these regions
  std::uint32_t nodes;          ///< tree nodes over them and the base mesh: no query can read more
  std::array<double, 3> worst;  ///< where most parts are needed, model frame

  double step;             ///< file units
  std::uint32_t entering;  ///< records that one cube needs and the one before it does not
  std::uint32_t units;     ///< of Budget (spm/forest.hpp), to go from what one cube needs to what the next does
  std::uint32_t faces;     ///< that this bears, takes away or deforms, at most
  std::vector<RegionId> units_from, units_to;  ///< regions before and after the step that takes most units
  /// What a host sends for the worst such step: regions, each with those of its records that none before it brought.
  struct Bringing {
    RegionId region;
    std::vector<Interval> missing;
  };
  std::vector<Bringing> brings;
  /// Most cubes that a straight way enters in a second, all as bad as the worst: a bound, not an expectation.
  [[nodiscard]] double steps_per_second() const noexcept { return std::sqrt(3.0) * speed / step; }
};

/// `model` must be sound. Some seconds for 10^5 regions. Allocates.
[[nodiscard]] Certificate certify(const Model& model, double radius, double speed);

/// The slots of a pool with room for the base mesh and for what the ball needs at once.
[[nodiscard]] std::uint32_t slots_needed(const ModelSummary& summary, const Certificate& certificate) noexcept;
/// The least that a controller of this one object may hold of models (shares_of in spm/directory.hpp) to have those.
[[nodiscard]] std::uint64_t memory_needed(const ModelSummary& summary, const Certificate& certificate) noexcept;

/// The most nodes that AbTree::refit recomputes when so many faces have changed.
[[nodiscard]] std::uint64_t max_marked(std::uint64_t faces, std::uint64_t finest_faces);

/// Nodes and levels of a tree over the faces whose nodes have `width` children, leaves not counted as nodes.
struct TreeSize {
  std::uint32_t levels;
  std::uint64_t nodes;
};
[[nodiscard]] TreeSize tree_size(std::uint64_t leaves, std::uint32_t width);

}  // namespace tactus::spm::offline
