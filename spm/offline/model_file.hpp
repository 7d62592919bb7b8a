/// The `.spm` file: a model's sections, little endian, aligned, checksummed, ready to be mapped.
///
///   header   64 bytes   magic "tactSPM\n", version, sections, file size, XXH3-64 of header and table
///   table    32 bytes   for each section: kind, 0, offset, size in bytes, XXH3-64 of these bytes
///   sections            each from a multiple of 64: summary, positions, base radii, base faces, parts, regions, runs,
///                       statistics (JSON)
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "spm/model.hpp"
#include "spm/offline/clean.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

inline constexpr std::uint32_t kModelFileVersion = 2;

/// Where a model came from and what import dropped; no part of its digest.
struct Provenance {
  std::string source;  ///< file name without folder
  CleanReport cleaned;
};

/// XXH3-64 over the summary (its digest taken as 0) and all arrays.
[[nodiscard]] std::uint64_t digest_of(const Model& model);

/// Writes beside `path`, syncs, renames: `path` is old or new, never half. Throws ModelError naming path and cause;
/// nothing is left behind then.
void write_model(const std::filesystem::path& path, const Model& model, const Provenance& provenance);

/// Whether the file begins as an `.spm` file does; false when it cannot be read.
[[nodiscard]] bool is_model_file(const std::filesystem::path& path);

/// A model file in memory, checked whole when opened: size, version, checksums, violations(). Move only.
class MappedModel {
 public:
  /// Throws ModelError naming the file, what was found and what was expected.
  explicit MappedModel(const std::filesystem::path& path);
  ~MappedModel();
  MappedModel(MappedModel&& other) noexcept;
  MappedModel& operator=(MappedModel&& other) noexcept;

  /// Borrows from this.
  [[nodiscard]] const Model& model() const noexcept { return model_; }
  [[nodiscard]] const Provenance& provenance() const noexcept { return provenance_; }

 private:
  MappedModel() = default;

  void* data_ = nullptr;
  std::size_t size_ = 0;
  Model model_;
  Provenance provenance_;
};

}  // namespace tactus::spm::offline
