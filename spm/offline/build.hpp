/// Builds a model from triangles: clean, simplify, find dependencies, divide into regions, number.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/clean.hpp"
#include "spm/offline/partition.hpp"
#include "spm/offline/simplify.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

struct BuildOptions {
  SimplifyOptions simplify;
  PartitionOptions partition;
  double metres_per_unit = 1;
  std::optional<double> size;  ///< metres of the longest side of the bounds; overrides `metres_per_unit`
  double pair_distance = 0;    ///< metres, overrides `simplify.pair_distance` unless 0
  /// Compact profile: moves coordinates to a grid of this many bits over the longest side, 4 to 20. 0: lossless.
  unsigned grid_bits = 0;
  Losses losses = Losses::kRefuse;  ///< in reading and cleaning; faces that a grid drops do not count
  unsigned threads = 0;             ///< 0: all processors; does not affect the result
};

/// Called with the stage and its finished share, 0 to 1, at the start of the stage and from time to time, in the
/// building thread. Stages in order: read, clean, order, simplify, depend, divide, number, list, sum up.
using Progress = std::function<void(std::string_view stage, double done)>;

struct BuiltModel : OwnedModel {
  CleanReport cleaned;
};

/// Equal meshes and options give equal bytes. Cleans the mesh first. Throws ModelError if no face is left, if there are
/// too many, or if most faces or vertices were dropped and `losses` does not allow it.
[[nodiscard]] BuiltModel build_model(TriangleMesh mesh, const BuildOptions& options = {},
                                     const Progress& progress = {});

/// Imports and builds. Every message names the file.
[[nodiscard]] BuiltModel build_model_file(const std::filesystem::path& path, const BuildOptions& options = {},
                                          const Progress& progress = {});

}  // namespace tactus::spm::offline
