/// Gives access to a whole model in its compressed form. An `.spm` file stores these bytes, and a VE host serves them
/// without decoding.
///
///     base         the base mesh message, with the prefix codes (base_codec.hpp)
///     regions      all regions, without their lists (page_codec.hpp)
///     codes        the codes of all records, in order of their numbers (record_codes.hpp)
///     lists        for each region, the intervals of its record list
///     sizes        number of bits, as a varint, of each block of kRecordsPerBlock records in `codes`, and then of each
///                  region's list
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "spm/codec/base_codec.hpp"
#include "spm/codec/bits.hpp"
#include "spm/codec/block_checksums.hpp"
#include "spm/codec/record_codes.hpp"
#include "spm/codec/result.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

struct ModelSpans {
  std::span<const std::uint8_t> base, regions, codes, lists, sizes;
};

class CompressedModel {
 public:
  /// Decodes and checks the base mesh and the regions, and checks the number of sizes. decode_model() checks codes and
  /// lists; this function does not. Unchecked codes and lists may be wrong, but no function reads past their end. The
  /// spans must outlive the result.
  static Result<CompressedModel> open(const ModelSpans& spans);
  /// Makes an empty object, to which a model can be assigned.
  CompressedModel() = default;

  /// Sets the checksums with which `damage` checks the bytes of codes and lists. Without this call, all are sound.
  void set_checksums(std::shared_ptr<const BlockChecksums> codes,
                     std::shared_ptr<const BlockChecksums> lists) noexcept {
    code_checksums_ = std::move(codes);
    list_checksums_ = std::move(lists);
  }

  [[nodiscard]] const ModelSummary& summary() const noexcept { return base_.mesh.summary; }
  [[nodiscard]] const BaseMesh& base() const noexcept { return base_.mesh; }
  [[nodiscard]] std::span<const Region> regions() const noexcept { return regions_; }
  [[nodiscard]] const RecordTables& tables() const noexcept { return base_.tables; }
  [[nodiscard]] const ModelSpans& spans() const noexcept { return spans_; }
  /// First bit of each block in `codes`. The last entry is the end of `codes`, in bits.
  [[nodiscard]] const std::vector<std::uint64_t>& block_starts() const noexcept { return block_starts_; }
  /// First bit of each region's list in `lists`. The last entry is the end of `lists`, in bits.
  [[nodiscard]] const std::vector<std::uint64_t>& list_starts() const noexcept { return list_starts_; }

  /// Decodes the region's record list. Returns an empty list if its bits are damaged. O(intervals), allocates.
  [[nodiscard]] std::vector<Interval> intervals_of(RegionId region) const;

  /// Returns a description of the first damage in the list of the region or in the codes of these records, or an empty
  /// string. The first check of a block of bytes reads the whole block (block_checksums.hpp).
  [[nodiscard]] std::string damage(RegionId region, std::span<const Interval> records) const;

  /// Checks all bytes of codes and lists. Returns as the function above.
  [[nodiscard]] std::string damage() const;

  /// Appends the codes of these records in the form of a message. O(records + intervals x kRecordsPerBlock), because
  /// the first record of an interval is found by reading its block from the start.
  void put_records(BitWriter& out, std::span<const Interval> records) const;

 private:
  [[nodiscard]] std::string list_damage(RegionId region) const;

  DecodedBase base_;
  std::vector<Region> regions_;
  ModelSpans spans_;
  std::vector<std::uint64_t> block_starts_, list_starts_;
  std::shared_ptr<const BlockChecksums> code_checksums_, list_checksums_;  // null: not checked
};

}  // namespace tactus::spm::codec
