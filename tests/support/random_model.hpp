/// A random model that passes spm::violations, made by splitting at random instead of simplifying.
///
/// Its surface makes no geometric sense, but its records, closures and regions have the form of real ones, chains of
/// several parts included. For tests of what carries a model, not of what refines it. Same seed, same model.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "spm/model.hpp"

namespace tactus::test_support {

struct OwnedModel {
  spm::ModelSummary summary{};
  std::vector<std::array<float, 3>> positions;
  std::vector<std::uint16_t> base_radii;
  std::vector<spm::BaseFace> base_faces;
  std::vector<spm::RecordPart> parts;
  std::vector<spm::Region> regions;
  std::vector<spm::Run> runs;

  /// Borrows from this.
  [[nodiscard]] spm::Model view() const { return {summary, positions, base_radii, base_faces, parts, regions, runs}; }
};

/// `records` splits of an octahedron, cells of an even grid of `cells` per axis over it.
[[nodiscard]] OwnedModel random_model(std::uint64_t seed, std::uint32_t records, std::uint32_t cells);

}  // namespace tactus::test_support
