/// Reads records back from their codes, trusting nothing: see record_codes.hpp for the form.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "spm/codec/record_codes.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

class RecordReader {
 public:
  /// Anchor, radius, shape, corner, a face and the coordinates, a bit each.
  static constexpr std::uint64_t kMinBits = 8;

  /// Both must outlive it.
  RecordReader(const ModelSummary& summary, const RecordTables& tables);

  /// The record's first face, where its code begins: of the first in a lot or run, or of one that follows. What is
  /// wrong with it `get` will say.
  [[nodiscard]] std::uint32_t get_first_anchor(BitReader& in, std::uint32_t before) noexcept {
    named_.clear();
    return face_after(in, Field::kAnchorFirst, before);
  }
  [[nodiscard]] std::uint32_t get_anchor(BitReader& in, std::uint32_t before) noexcept {
    const std::uint32_t symbol = tables_[Field::kAnchor].get(in, code_ok_);
    if (symbol < NamedFaces::kSize) return named_[symbol];
    return before + static_cast<std::uint32_t>(unzigzag(rest_of_number(in, symbol - NamedFaces::kSize)));
  }
  /// Appends the record's parts as RegionData has them. False, with error(), when the bits are no code, or name what
  /// cannot be by the counts of the summary.
  [[nodiscard]] bool get(BitReader& in, std::uint32_t record, std::uint32_t anchor, std::vector<RecordPart>& parts,
                         std::array<std::uint32_t, 3>& offset);
  /// In words, beginning with the record.
  [[nodiscard]] const std::string& error() const noexcept { return error_; }

 private:
  bool get_usual(BitReader& in, std::uint32_t record, RecordPart& part, std::uint32_t anchor, const Shape& shape,
                 std::vector<RecordPart>& parts);
  bool get_spelt_out(BitReader& in, std::uint32_t record, RecordPart first, std::uint32_t anchor,
                     std::vector<RecordPart>& parts);
  bool get_born(BitReader& in, std::uint32_t record, std::uint32_t u, std::uint32_t face, RecordPart& part, int i);
  bool fail(std::uint32_t record, const char* what, std::uint64_t found, const char* relation, std::uint64_t expected);
  std::uint64_t number(BitReader& in, Field field) noexcept { return get_number(in, tables_[field], code_ok_); }
  /// Wraps, so that whatever comes of foreign bits is no face or some face.
  std::uint32_t face_after(BitReader& in, Field field, std::uint32_t face) noexcept {
    return face + static_cast<std::uint32_t>(unzigzag(number(in, field)));
  }

  const ModelSummary& summary_;
  const RecordTables& tables_;
  std::uint32_t max_;
  NamedFaces named_;
  bool code_ok_ = true;
  std::string error_;
};

}  // namespace tactus::spm::codec
