/// The `.spm` file: a model's sections, little endian, aligned, checksummed. Records lie in it as they are sent.
///
///   header   64 bytes   magic "tactSPM\n", version, sections, file size, XXH3-64 of header and table
///   table    32 bytes   for each section: kind, 0, offset, size in bytes, XXH3-64 of these bytes
///   sections            each from a multiple of 64: base mesh, codes, lists and sizes as in
///   codec/compressed_model.hpp,
///                       statistics (JSON)
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "spm/codec/model_codec.hpp"
#include "spm/model.hpp"
#include "spm/offline/clean.hpp"
#include "spm/offline/triangle_mesh.hpp"

namespace tactus::spm::offline {

inline constexpr std::uint32_t kModelFileVersion = 6;

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

/// A model file mapped into memory, checked whole when opened: size, version, checksums, and the model that it holds,
/// which is decoded for that. Move only.
class MappedModel {
 public:
  /// Who needs the model as arrays gets those that were checked. Throws ModelError naming the file, what was found and
  /// what was expected.
  explicit MappedModel(const std::filesystem::path& path, OwnedModel* arrays = nullptr);
  MappedModel(MappedModel&&) noexcept;
  MappedModel& operator=(MappedModel&&) noexcept;
  ~MappedModel();

  /// Borrows from this.
  [[nodiscard]] const codec::CompressedModel& coded() const noexcept { return coded_; }
  [[nodiscard]] const ModelSummary& summary() const noexcept { return coded_.summary(); }
  [[nodiscard]] const Provenance& provenance() const noexcept { return provenance_; }

 private:
  struct Mapping;
  std::unique_ptr<const Mapping> mapping_;
  codec::CompressedModel coded_;
  Provenance provenance_;
};

}  // namespace tactus::spm::offline
