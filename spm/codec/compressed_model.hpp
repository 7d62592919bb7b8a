/// A whole model in the form in which it is stored and sent; an `.spm` file has these bytes, and a VE host serves them
/// without decoding.
///
///     base         the base mesh message (base_codec.hpp), with the prefix codes
///     codes        the codes of all records, in order (record_codes.hpp)
///     lists        by region: the intervals of its record list
///     sizes        in bits, as varints: of each block of kRecordsPerBlock records in `codes`, then of each region's
///     list
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "spm/codec/base_codec.hpp"
#include "spm/codec/bits.hpp"
#include "spm/codec/record_codes.hpp"
#include "spm/codec/result.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

struct ModelSpans {
  std::span<const std::uint8_t> base, codes, lists, sizes;
};

class CompressedModel {
 public:
  /// Decodes and checks the base mesh, and checks the number of sizes. decode_model() checks codes and lists; without
  /// it, codes and lists that are not trusted are never read past their end, but may be wrong. The spans must outlive
  /// the result.
  static Result<CompressedModel> open(const ModelSpans& spans);
  /// Empty: for later assignment.
  CompressedModel() = default;

  [[nodiscard]] const ModelSummary& summary() const noexcept { return base_.mesh.summary; }
  [[nodiscard]] const BaseMesh& base() const noexcept { return base_.mesh; }
  [[nodiscard]] const RecordTables& tables() const noexcept { return base_.tables; }
  [[nodiscard]] const ModelSpans& spans() const noexcept { return spans_; }
  /// By block: its first bit in `codes`; then the end of `codes`.
  [[nodiscard]] const std::vector<std::uint64_t>& code_places() const noexcept { return code_places_; }
  /// By region: the first bit of its list; then the end of `lists`.
  [[nodiscard]] const std::vector<std::uint64_t>& list_places() const noexcept { return list_places_; }

  /// The region's record list. O(intervals), allocates.
  [[nodiscard]] std::vector<Interval> intervals_of(RegionId region) const;

  /// Appends the codes of these records in the form of a message. O(records + intervals x kRecordsPerBlock): the block
  /// of an interval is read from its start to find the first record.
  void put_records(BitWriter& out, std::span<const Interval> records) const;

 private:
  DecodedBase base_;
  ModelSpans spans_;
  std::vector<std::uint64_t> code_places_, list_places_;
};

}  // namespace tactus::spm::codec
