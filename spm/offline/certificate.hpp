/// What a controller can ever need of a model for one probe, known before a session starts.
#pragma once

#include <array>
#include <cstdint>

#include "spm/model.hpp"

namespace tactus::spm::offline {

/// Upper bounds over all positions of a ball: its centre is taken through cubes much smaller than a cell, and in each
/// the regions are counted that the ball may meet from anywhere in the cube.
struct Certificate {
  double radius;                ///< of the ball, file units
  std::uint32_t regions;        ///< labelled cells at once
  std::uint32_t records;        ///< in the union of their lists
  std::uint32_t parts;          ///< pool slots of these records; the base mesh comes on top
  std::array<double, 3> worst;  ///< where most parts are needed, model frame
};

/// `model` must be sound. Allocates.
[[nodiscard]] Certificate certify(const Model& model, double radius);

/// Nodes and levels of a tree over the faces whose nodes have `width` children, leaves not counted as nodes.
struct TreeSize {
  std::uint32_t levels;
  std::uint64_t nodes;
};
[[nodiscard]] TreeSize tree_size(std::uint64_t leaves, std::uint32_t width);

}  // namespace tactus::spm::offline
