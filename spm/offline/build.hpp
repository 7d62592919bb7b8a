/// From triangles to a model that can be served: clean, simplify, find what depends on what, divide into regions,
/// number.
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
  /// Compact profile: coordinates are moved to a grid of this many bits over the longest side, 4 to 20. 0: lossless.
  unsigned grid_bits = 0;
  Losses losses = Losses::kRefuse;  ///< of reading and cleaning; what a grid drops is asked for
  unsigned threads = 0;             ///< 0: all there are; the result is the same
};

/// Gets the stage and the share of it that is done, 0 to 1, as it begins and now and then; in the thread that builds.
/// Stages are, in this order: read, clean, order, simplify, depend, divide, number, list, sum up.
using Progress = std::function<void(std::string_view stage, double done)>;

struct BuiltModel : OwnedModel {
  CleanReport cleaned;
};

/// The same mesh and options give the same bytes. Cleans first. Throws ModelError when no face is left after that, when
/// there are too many, or when most faces or vertices were dropped and `losses` does not allow it.
[[nodiscard]] BuiltModel build_model(TriangleMesh mesh, const BuildOptions& options = {},
                                     const Progress& progress = {});

/// Imports and builds; every message names the file.
[[nodiscard]] BuiltModel build_model_file(const std::filesystem::path& path, const BuildOptions& options = {},
                                          const Progress& progress = {});

}  // namespace tactus::spm::offline
