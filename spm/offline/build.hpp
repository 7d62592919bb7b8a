/// Builds a model from triangles. Cleans and simplifies the mesh, finds the dependencies of the records, divides the
/// model into regions, and numbers records, vertices and faces.
#pragma once

#include <filesystem>
#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include "spm/model.hpp"
#include "spm/offline/clean.hpp"
#include "spm/offline/import.hpp"
#include "spm/offline/partition.hpp"
#include "spm/offline/simplify.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

struct BuildOptions {
  SimplifyOptions simplify;
  PartitionOptions partition;
  double metres_per_unit = 1;
  std::optional<double> size;  ///< longest side of the bounds, metres; overrides `metres_per_unit`
  double pair_distance = 0;    ///< metres; unless 0, overrides `simplify.pair_distance`
  /// 4 to 20: compact profile, with 2^grid_bits grid positions along the longest side. 0: lossless profile.
  unsigned grid_bits = 0;
  LossPolicy losses =
      LossPolicy::kRefuse;  ///< applies to reading and cleaning, not to faces that the grid makes degenerate
  unsigned threads = 0;     ///< 0: one per processor; does not affect the result
};

/// Receives the name of the current stage and its finished share, 0 to 1. It is called in the thread that called the
/// build, at the start of each stage and repeatedly during the long stages. Stages in order: read, clean, order,
/// simplify, depend, divide, number, list, sum up.
using Progress = std::function<void(std::string_view stage, double done)>;

struct BuiltModel : OwnedModel {
  CleanReport cleaned;
};

/// Throws ModelError that names the limit if a model cannot have so many faces.
void require_face_count(std::size_t faces);

/// Builds a model from a mesh, which need not be clean. Equal meshes and options give equal bytes. Throws ModelError if
/// no face is left after cleaning, if there are too many faces, or if cleaning dropped most faces or vertices and
/// `losses` does not allow it.
[[nodiscard]] BuiltModel build_model(TriangleMesh mesh, const BuildOptions& options = {},
                                     const Progress& progress = {});

/// Imports a file and builds a model from it. `on_read` is called after the import, with the names that import_mesh()
/// gives. Throws ModelError that names the file.
[[nodiscard]] BuiltModel build_model_file(const std::filesystem::path& path, const BuildOptions& options = {},
                                          const Progress& progress = {},
                                          const std::function<void(const FileNames& requested)>& on_read = {});

}  // namespace tactus::spm::offline
