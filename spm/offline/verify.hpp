/// Compares a model with its original mesh to the bit: all faces of the finest mesh, and the faces of each region.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

struct Verification {
  std::uint32_t faces = 0;              ///< number of faces of the original
  std::uint32_t regions = 0;            ///< number of regions that were refined alone
  std::uint64_t faces_in_regions = 0;   ///< number of faces that were compared while one region was refined
  std::vector<std::string> mismatches;  ///< descriptions of the first ten; empty if the model is exact
};

/// Cleans `original` and checks that
/// - the finest mesh has exactly the faces of the original, as oriented triples of positions;
/// - if one region alone is refined, every face that intersects its cell is finest;
/// - every corner and the centre of every face is in an occupied subcell of a labelled cell.
/// `model` must be sound. Calls `progress` with the finished share, 0 to 1.
[[nodiscard]] Verification verify(const Model& model, TriangleMesh original,
                                  const std::function<void(double)>& progress = {});

}  // namespace tactus::spm::offline
