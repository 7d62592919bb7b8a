/// Reads the triangles of a model file in this process. Only the program tactus-import does this, without rights.
#pragma once

#include <filesystem>
#include <istream>
#include <memory>
#include <string>

#include "spm/offline/clean.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::importer {

/// The files of a model: the model itself, and those that it names.
class ModelFiles {
 public:
  virtual ~ModelFiles() = default;

  /// Returns a file at its beginning, or null if it cannot be opened. `name`: path from the folder of the model.
  [[nodiscard]] virtual std::unique_ptr<std::istream> open(const std::string& name) = 0;
};

/// Reads a model as import_mesh() of spm/offline/import.hpp does. The file is `model.filename()` of `files`; messages
/// name `model`.
[[nodiscard]] offline::TriangleMesh read_mesh(const std::filesystem::path& model, ModelFiles& files,
                                              offline::LossPolicy losses);

}  // namespace tactus::spm::importer
