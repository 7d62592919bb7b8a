/// A whole model as arrays to a whole model as bytes, and back.
#pragma once

#include <array>
#include <vector>

#include "spm/codec/coded_model.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

/// A coded model that owns its bytes.
class EncodedModel {
 public:
  /// `model` has no violations(). About 0.4 us a record.
  explicit EncodedModel(const Model& model);
  EncodedModel(EncodedModel&&) noexcept = default;
  EncodedModel& operator=(EncodedModel&&) noexcept = default;

  /// Borrows from this, and stays valid when this is moved.
  [[nodiscard]] const CodedModel& coded() const noexcept { return coded_; }

 private:
  Bytes base_, codes_, lists_, sizes_;
  CodedModel coded_;
};

/// Owns what its model() borrows.
struct DecodedModel {
  ModelSummary summary{};
  std::vector<std::array<float, 3>> positions;
  std::vector<std::uint16_t> base_radii;
  std::vector<BaseFace> base_faces;
  std::vector<RecordPart> parts;
  std::vector<Region> regions;
  std::vector<Run> runs;

  [[nodiscard]] Model model() const { return {summary, positions, base_radii, base_faces, parts, regions, runs}; }
};

/// Trusts nothing; memory stays within what the summary and the input allow for. Names every parent and third corner
/// and puts every vertex in its place, but leaves it to violations() to say whether records and lists make a sound
/// model. About 0.3 us a record.
Result<DecodedModel> decode_model(const CodedModel& coded);

}  // namespace tactus::spm::codec
