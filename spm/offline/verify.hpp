/// Does a model give back the mesh that it was made from? Face by face and bit by bit, whole and region by region.
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
  std::uint64_t faces_in_regions = 0;   ///< compared while only one region was refined
  std::vector<std::string> mismatches;  ///< the first few, in words; empty when the model is exact
};

/// `original` is cleaned first. Checks that
/// - all records applied give the original's faces, as oriented triples of positions, no more and no fewer;
/// - with only one region's list applied, every face that meets its cell is there in its finest version;
/// - every corner and every centre of a face lies in an occupied part of a labelled cell.
/// `model` must be sound. `progress` gets the share done.
[[nodiscard]] Verification verify(const Model& model, TriangleMesh original,
                                  const std::function<void(double)>& progress = {});

}  // namespace tactus::spm::offline
