/// The `.spm` file: a model's sections, little endian, aligned, with checksums. Records have the form of a message.
///
///   header   64 bytes   magic "tactSPM\n", version, sections, file size, XXH3-64 of header and table
///   table    32 bytes   for each section: kind, 0, offset, size in bytes, XXH3-64 of these bytes
///   sections            each at a multiple of 64: base mesh, codes, lists and sizes (codec/compressed_model.hpp),
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

/// The source of a model and the losses of its import; not part of the digest.
struct Provenance {
  std::string source;  ///< file name without folder
  CleanReport cleaned;
};

/// XXH3-64 over the summary (with digest 0) and all arrays.
[[nodiscard]] std::uint64_t digest_of(const Model& model);

/// Writes a temporary file next to `path`, syncs and renames it, so `path` is never incomplete. Throws ModelError that
/// names path and cause; the temporary file is then removed.
void write_model(const std::filesystem::path& path, const Model& model, const Provenance& provenance);

/// True if the file can be read and has the magic of an `.spm` file.
[[nodiscard]] bool is_model_file(const std::filesystem::path& path);

/// A model file mapped into memory. The constructor checks all of it: size, version, checksums and the decoded model.
/// Move only.
class MappedModel {
 public:
  /// `arrays`, if given, is set to the decoded model. Throws ModelError that names the file, the value found and the
  /// value expected.
  explicit MappedModel(const std::filesystem::path& path, OwnedModel* arrays = nullptr);
  MappedModel(MappedModel&&) noexcept;
  MappedModel& operator=(MappedModel&&) noexcept;
  ~MappedModel();

  /// Refers to the mapped memory of this object.
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
