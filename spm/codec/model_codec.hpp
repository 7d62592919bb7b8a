/// A whole model as arrays to a whole model as bytes, and back.
#pragma once

#include "spm/codec/compressed_model.hpp"
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
  [[nodiscard]] const CompressedModel& coded() const noexcept { return coded_; }

 private:
  Bytes base_, codes_, lists_, sizes_;
  CompressedModel coded_;
};

/// Trusts nothing; memory stays within what the summary and the input allow for. Names every parent and third corner
/// and puts every vertex in its place, but leaves it to violations() to say whether records and lists make a sound
/// model. About 0.3 us a record.
Result<OwnedModel> decode_model(const CompressedModel& coded);

}  // namespace tactus::spm::codec
