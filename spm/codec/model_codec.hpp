/// Encodes a whole model, and decodes it.
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

  /// The compressed model. It refers to the bytes of this object and remains valid if this object is moved.
  [[nodiscard]] const CompressedModel& compressed() const noexcept { return compressed_; }

 private:
  Bytes base_, regions_, codes_, lists_, sizes_;
  CompressedModel compressed_;
};

/// Decodes bytes that are not trusted. The summary and the number of bytes bound the memory. Checks each record against
/// the mesh of the previous records (RecordDecoder). Does not check whether records and lists are a sound model;
/// violations() does. About 0.3 us a record.
Result<OwnedModel> decode_model(const CompressedModel& compressed);

}  // namespace tactus::spm::codec
