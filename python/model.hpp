/// A mesh and a model with everything that the package needs of them.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/model_file.hpp"
#include "spm/region_grid.hpp"

namespace tactus::python {

/// A mesh and the name of its source, which an .spm file states.
struct SourcedMesh {
  spm::offline::TriangleMesh mesh;
  std::string source;
};

/// A model that was built, or opened from an .spm file. Threads: any. Computes other forms of the model when they are
/// first needed; they exist as long as the model.
class SharedModel {
 public:
  /// Opens a file. Throws ModelError.
  explicit SharedModel(const std::filesystem::path& path);
  SharedModel(spm::offline::BuiltModel built, std::string source);

  [[nodiscard]] const spm::OwnedModel& arrays() const noexcept { return arrays_; }
  [[nodiscard]] const spm::ModelSummary& summary() const noexcept { return arrays_.summary; }
  [[nodiscard]] const spm::offline::Provenance& provenance() const noexcept { return provenance_; }
  [[nodiscard]] const std::vector<std::array<std::uint32_t, 3>>& base_faces() const;
  [[nodiscard]] const std::vector<std::array<std::uint32_t, 3>>& finest_faces() const;
  [[nodiscard]] const spm::codec::CompressedModel& compressed() const;
  [[nodiscard]] const spm::RegionGrid& grid() const;

  /// The faces of the mesh in which exactly the records of these regions are applied. Throws std::invalid_argument for
  /// a region that does not exist.
  [[nodiscard]] std::vector<std::array<std::uint32_t, 3>> refined_faces(std::span<const std::int64_t> regions) const;

 private:
  std::optional<spm::offline::MappedModel> file_;
  spm::OwnedModel arrays_;
  spm::offline::Provenance provenance_;
  mutable std::once_flag base_once_, finest_once_, encoded_once_, grid_once_;
  mutable std::vector<std::array<std::uint32_t, 3>> base_, finest_;
  mutable std::optional<spm::codec::EncodedModel> encoded_;
  mutable std::optional<spm::RegionGrid> grid_;
};

}  // namespace tactus::python
