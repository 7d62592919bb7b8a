/// Compares a model with the original mesh, face by face and bit by bit, as a whole and region by region.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

struct Verification {
  std::uint32_t faces = 0;              ///< of the original
  std::uint32_t regions = 0;            ///< refined one by one
  std::uint64_t faces_in_regions = 0;   ///< compared with only one region refined
  std::vector<std::string> mismatches;  ///< descriptions of the first few; empty if the model is exact
};

/// `original` is cleaned first. Checks that
/// - all records together give exactly the faces of the original, as oriented triples of positions;
/// - one region's list alone gives the finest version of every face that intersects its cell;
/// - every corner and every centre of a face is in an occupied part of a labelled cell.
/// `model` must be sound. Calls `progress` with the finished share.
[[nodiscard]] Verification verify(const Model& model, TriangleMesh original,
                                  const std::function<void(double)>& progress = {});

}  // namespace tactus::spm::offline
