/// Reads and writes `.spm` files. A file has the sections of one model, little-endian, aligned, with checksums. Records
/// have the same codes as in messages.
///
///   header     64 bytes             magic "tactSPM\n", version, number of sections, file size, XXH3-64 of header
///                                   (with checksum 0) and table, 32 zero bytes
///   table      32 bytes a section   kind, 0, offset, size in bytes, XXH3-64 of the section
///   sections   each at an offset    base mesh, regions, codes, lists and sizes (codec/compressed_model.hpp),
///              divisible by 64      statistics (JSON), checksums of the blocks of codes and lists
///                                   (codec/block_checksums.hpp)
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

inline constexpr std::uint32_t kModelFileVersion = 9;

/// The source of a model, and the vertices and faces dropped by its build. The digest does not cover it.
struct Provenance {
  std::string source;  ///< name of the original file, without folder
  CleanReport cleaned;
};

/// Writes a temporary file in the folder of `path`, syncs and renames it, so that `path` is never incomplete. Throws
/// ModelError that names path and cause if that fails, or if the base mesh has violations; then no new file remains.
void write_model(const std::filesystem::path& path, const Model& model, const Provenance& provenance);

/// True if the file can be read and has the magic of an `.spm` file.
[[nodiscard]] bool is_model_file(const std::filesystem::path& path);

/// A model file mapped into memory. Codes and lists, which are nearly all of the file, are checked block by block when
/// they are used (CompressedModel::damage). So a large file opens without being read. Move only.
///
/// The file must not become shorter while it is mapped: a read beyond its end raises SIGBUS. If its bytes change, reads
/// return wrong bytes, which do no harm. To replace the file, rename another one to its name, as write_model does.
class MappedModel {
 public:
  /// Checks size, version, and all sections but codes and lists. O(base mesh + regions). Throws ModelError that names
  /// the file, the value found and the value expected.
  explicit MappedModel(const std::filesystem::path& path);
  MappedModel(MappedModel&&) noexcept;
  MappedModel& operator=(MappedModel&&) noexcept;
  ~MappedModel();

  /// Reads the whole file and checks the checksums of all blocks of codes and lists. Throws ModelError.
  void check_checksums() const;
  /// Decodes the model and checks all of it. Costs some 0.5 us a record and 64 bytes a record part. Throws ModelError.
  [[nodiscard]] OwnedModel decode() const;

  /// The compressed model, which refers to the mapped memory of this object.
  [[nodiscard]] const codec::CompressedModel& compressed() const noexcept { return compressed_; }
  [[nodiscard]] const ModelSummary& summary() const noexcept { return compressed_.summary(); }
  [[nodiscard]] const Provenance& provenance() const noexcept { return provenance_; }

 private:
  struct Mapping;
  void set_checksums();
  std::filesystem::path path_;
  std::unique_ptr<const Mapping> mapping_;
  codec::CompressedModel compressed_;
  Provenance provenance_;
};

}  // namespace tactus::spm::offline
