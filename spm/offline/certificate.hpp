/// What a controller can ever need of a model for one probe, known before a session starts.
#pragma once

#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm::offline {

/// Upper bounds over all positions of a ball. A ball that meets region i meets no region further from it than its
/// diameter, so the union over these bounds what it needs.
struct Certificate {
  double radius;          ///< of the ball, file units
  std::uint32_t regions;  ///< labelled cells at once
  std::uint32_t records;  ///< in the union of their lists
  std::uint32_t parts;    ///< pool slots of these records; the base mesh comes on top
  RegionId worst;         ///< the region around which most parts are needed
};

/// `model` must be sound. O(regions x neighbours x list), allocates.
[[nodiscard]] Certificate certify(const Model& model, double radius);

/// Nodes and levels of a tree over the faces whose nodes have `width` children, leaves not counted as nodes.
struct TreeSize {
  std::uint32_t levels;
  std::uint64_t nodes;
};
[[nodiscard]] TreeSize tree_size(std::uint64_t leaves, std::uint32_t width);

}  // namespace tactus::spm::offline
