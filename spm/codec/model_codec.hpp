/// Converts a whole model between arrays and bytes.
#pragma once

#include "spm/codec/compressed_model.hpp"
#include "spm/model.hpp"

namespace tactus::spm::codec {

/// A compressed model that owns its bytes.
class EncodedModel {
 public:
  /// `model` must have no violations(). About 0.4 us a record.
  explicit EncodedModel(const Model& model);
  EncodedModel(EncodedModel&&) noexcept = default;
  EncodedModel& operator=(EncodedModel&&) noexcept = default;

  /// Refers to the bytes of this object; stays valid if this object is moved.
  [[nodiscard]] const CompressedModel& coded() const noexcept { return coded_; }

 private:
  Bytes base_, codes_, lists_, sizes_;
  CompressedModel coded_;
};

/// The bytes are not trusted. Memory is bounded by the summary and the input. Each record is checked against the mesh
/// before it (RecordDecoder); whether records and lists are a sound model is for violations() to check. About 0.3 us a
/// record.
Result<OwnedModel> decode_model(const CompressedModel& coded);

}  // namespace tactus::spm::codec
