/// Decodes regions of a compressed model for LocalRefinement. The model can be a mapped .spm file
/// (spm/offline/model_file.hpp), a model that this process has encoded (model_codec.hpp), or bytes in memory
/// (CompressedModel::open).
#pragma once

#include "spm/codec/compressed_model.hpp"
#include "spm/local_refinement.hpp"

namespace tactus::spm::codec {

class CompressedSource final : public RegionSource {
 public:
  /// `model` must outlive this object.
  explicit CompressedSource(const CompressedModel& model) : model_{model} {}

  [[nodiscard]] const BaseMesh& base() const override { return model_.base(); }
  [[nodiscard]] std::span<const Region> regions() const override { return model_.regions(); }
  /// Returns the region with all its records. Throws std::runtime_error if it is damaged. About 0.3 us a record;
  /// allocates.
  [[nodiscard]] RegionData region(RegionId region) override;

 private:
  const CompressedModel& model_;
};

}  // namespace tactus::spm::codec
