/// Reads records from their codes. The bits are not trusted. See record_codes.hpp for the format.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "spm/codec/record_codes.hpp"
#include "spm/model.hpp"
#include "spm/position_predictor.hpp"

namespace tactus::spm::codec {

class RecordReader {
 public:
  /// At least one bit each: anchor, radius, shape, corner, a face and three residuals.
  static constexpr std::uint64_t kMinBits = 8;

  /// Both must outlive it.
  RecordReader(const ModelSummary& summary, const RecordTables& tables);

  /// Read the anchor, with which the code of a record begins: of the first record of a block or interval, or of the
  /// next record. `get` checks it.
  [[nodiscard]] FaceId get_first_anchor(BitReader& in, FaceId before) noexcept {
    named_.clear();
    return face_after(in, Field::kAnchorFirst, before);
  }
  [[nodiscard]] FaceId get_anchor(BitReader& in, FaceId before) noexcept {
    const std::uint32_t symbol = tables_[Field::kAnchor].get(in, code_ok_);
    if (symbol < NamedFaces::kSize) return named_[symbol];
    return moved(before, rest_of_number(in, symbol - NamedFaces::kSize));
  }
  /// Appends the parts of the record in the form of RegionData. False, with error(), if the bits are not a code, or an
  /// id or count exceeds that of the summary.
  [[nodiscard]] bool get(BitReader& in, RecordId record, FaceId anchor, std::vector<RecordPart>& parts,
                         PositionPredictor::Residuals& residuals);
  /// Describes the error and names the record.
  [[nodiscard]] const std::string& error() const noexcept { return error_; }

 private:
  bool get_usual(BitReader& in, RecordId record, RecordPart& part, FaceId anchor, const Shape& shape,
                 std::vector<RecordPart>& parts);
  bool get_spelt_out(BitReader& in, RecordId record, RecordPart first, FaceId anchor, std::vector<RecordPart>& parts);
  bool get_born(BitReader& in, RecordId record, VertexId u, FaceId face, RecordPart& part, int i);
  bool fail(RecordId record, const char* what, std::uint64_t found, const char* relation, std::uint64_t expected);
  std::uint64_t number(BitReader& in, Field field) noexcept { return get_number(in, tables_[field], code_ok_); }
  /// Wraps. The caller checks the result against the number of faces.
  static FaceId moved(FaceId face, std::uint64_t difference) noexcept {
    return FaceId{index(face) + static_cast<std::uint32_t>(unzigzag(difference))};
  }
  FaceId face_after(BitReader& in, Field field, FaceId face) noexcept { return moved(face, number(in, field)); }

  const ModelSummary& summary_;
  const RecordTables& tables_;
  std::uint32_t max_;
  NamedFaces named_;
  bool code_ok_ = true;
  std::string error_;
};

}  // namespace tactus::spm::codec
