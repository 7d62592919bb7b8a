/// A whole model as it is stored and sent: what an `.spm` file holds and a VE host serves, without decoding it.
///
///     base         the base mesh as sent (base_codec.hpp), tables included
///     codes        of all records, in order (record_codes.hpp)
///     lists        by region: the intervals of its record list, as sent
///     sizes        in bits, as varints: of the codes of each lot of kLot records, then of each region's list
#pragma once

#include <cstdint>
#include <vector>

#include "spm/codec/base_codec.hpp"
#include "spm/codec/bits.hpp"
#include "spm/codec/record_codes.hpp"
#include "spm/codec/result.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

struct ModelSpans {
  Span<const std::uint8_t> base, codes, lists, sizes;
};

class CompressedModel {
 public:
  /// Reads the base mesh and checks it, and that there are as many sizes as it says. What the codes and lists hold is
  /// for decode_model() to check: of foreign ones, that they are never read past their end is all that is promised.
  /// The spans must outlive what is returned.
  static Result<CompressedModel> open(const ModelSpans& spans);
  /// Of no model.
  CompressedModel() = default;

  [[nodiscard]] const ModelSummary& summary() const noexcept { return base_.mesh.summary; }
  [[nodiscard]] const BaseMesh& base() const noexcept { return base_.mesh; }
  [[nodiscard]] const RecordTables& tables() const noexcept { return base_.tables; }
  [[nodiscard]] const ModelSpans& spans() const noexcept { return spans_; }
  /// By lot: its first bit in the codes; at the end where they end.
  [[nodiscard]] const std::vector<std::uint64_t>& code_places() const noexcept { return code_places_; }
  /// The same by region, of the lists.
  [[nodiscard]] const std::vector<std::uint64_t>& list_places() const noexcept { return list_places_; }

  /// The region's record list. O(intervals), allocates.
  [[nodiscard]] std::vector<Interval> intervals_of(RegionId region) const;

  /// Appends the codes of these records as they are sent. O(records + intervals x kLot): what comes before in a run's
  /// lot is read to find its first record.
  void put_records(BitWriter& out, Span<const Interval> records) const;

 private:
  DecodedBase base_;
  ModelSpans spans_;
  std::vector<std::uint64_t> code_places_, list_places_;
};

}  // namespace tactus::spm::codec
