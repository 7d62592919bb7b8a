/// Decodes records from bits that are not trusted. record_codes.hpp describes the format.
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
  /// The minimum length of a record: one bit each for anchor, radius, shape, corner, one face and three residuals.
  static constexpr std::uint64_t kMinBits = 8;

  /// Both arguments must outlive the reader.
  RecordReader(const ModelSummary& summary, const RecordTables& tables);

  /// Reads the anchor of the first record of a block or interval. `before`: anchor of the previous record in the
  /// message. `get` checks the anchor.
  [[nodiscard]] FaceId get_first_anchor(BitReader& in, FaceId before) noexcept {
    recent_.clear();
    return face_after(in, Field::kAnchorFirst, before);
  }
  /// Reads the anchor of any other record.
  [[nodiscard]] FaceId get_anchor(BitReader& in, FaceId before) noexcept {
    const std::uint32_t symbol = tables_[Field::kAnchor].get(in, code_ok_);
    if (symbol < RecentFaces::kSize) return recent_[symbol];
    return moved(before, finish_number(in, symbol - RecentFaces::kSize));
  }
  /// Reads the code after the anchor. Appends the parts of the record in the form of RegionData and sets `residuals`.
  /// Returns false and sets error() if the bits are not a code, if an id exceeds the limit in the summary, or if the
  /// record changes more than kMaxChanges faces. The result does not depend on the records that were read before.
  [[nodiscard]] bool get(BitReader& in, RecordId record, FaceId anchor, std::vector<RecordPart>& parts,
                         PositionPredictor::Residuals& residuals);
  /// Description of the last error, with the number of the record.
  [[nodiscard]] const std::string& error() const noexcept { return error_; }

 private:
  bool get_usual_faces(BitReader& in, RecordId record, RecordPart& part, FaceId anchor, const Shape& shape,
                       std::vector<RecordPart>& parts);
  bool get_explicit_faces(BitReader& in, RecordId record, RecordPart first, FaceId anchor,
                          std::vector<RecordPart>& parts);
  bool get_born(BitReader& in, RecordId record, VertexId u, FaceId face, RecordPart& part, int i);
  bool fail(const BitReader& in, RecordId record, const std::string& what);
  bool fail(const BitReader& in, RecordId record, const char* what, std::uint64_t found, const char* relation,
            std::uint64_t expected);
  /// Returns whether all bits so far existed and were words of the codes. Sets the error if not.
  bool check_bits(const BitReader& in, RecordId record);
  std::uint64_t number(BitReader& in, Field field) noexcept { return get_number(in, tables_[field], code_ok_); }
  /// Adds a difference to a face id; the sum may wrap. The caller checks the result against the number of faces.
  static FaceId moved(FaceId face, std::uint64_t difference) noexcept {
    return FaceId{index(face) + static_cast<std::uint32_t>(unzigzag(difference))};
  }
  FaceId face_after(BitReader& in, Field field, FaceId face) noexcept { return moved(face, number(in, field)); }

  const ModelSummary& summary_;
  const RecordTables& tables_;
  std::uint32_t max_radius_;  // maximum radius code of the model
  RecentFaces recent_;
  bool code_ok_ = true;
  std::string error_;
};

}  // namespace tactus::spm::codec
