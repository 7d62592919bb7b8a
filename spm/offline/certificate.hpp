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
struct Certificate {
  double radius, speed;  ///< of the ball, file units and file units/s

  std::uint32_t regions;        ///< labelled cells at once
  std::uint32_t records;        ///< in the union of their lists
  std::uint32_t parts;          ///< pool slots of these records; the base mesh comes on top
  std::uint32_t blocks;         ///< list blocks of these regions
  std::array<double, 3> worst;  ///< where most parts are needed, model frame
  std::uint32_t nodes;          ///< tree nodes over what is shown there, the base mesh included

  double step;             ///< file units
  std::uint32_t entering;  ///< records that one cube needs and the one before it does not
  /// What a host sends for the worst such step: regions, each with those of its records that none before it brought.
  struct Bringing {
    RegionId region;
    std::vector<Run> missing;
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

/// Nodes and levels of a tree over the faces whose nodes have `width` children, leaves not counted as nodes.
struct TreeSize {
  std::uint32_t levels;
  std::uint64_t nodes;
};
[[nodiscard]] TreeSize tree_size(std::uint64_t leaves, std::uint32_t width);

}  // namespace tactus::spm::offline
