/// A compressed model with a flipped bit in a block of its codes, as in a damaged file.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "spm/codec/model_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"

namespace tactus::test_support {

/// The generated organ, whose codes have several blocks.
inline const spm::codec::EncodedModel& organ_of_several_blocks() {
  static const spm::codec::EncodedModel encoded{
      spm::offline::build_model(spm::offline::generate(spm::offline::Shape::kOrgan, 60'000)).model()};
  return encoded;
}

class DamagedModel {
 public:
  /// `sound` must outlive the object. Damages the second block.
  explicit DamagedModel(const spm::codec::CompressedModel& sound) {
    using spm::codec::BlockChecksums;
    spm::codec::ModelSpans spans = sound.spans();
    EXPECT_GT(BlockChecksums::blocks_in(spans.codes.size()), 3u);
    codes_.assign(spans.codes.begin(), spans.codes.end());
    codes_[BlockChecksums::kBlockBytes + 1234] ^= 16;
    auto checksums = BlockChecksums::of(spans.codes);
    spans.codes = codes_;
    compressed_ = *spm::codec::CompressedModel::open(spans);
    compressed_.set_checksums(
        std::make_shared<const BlockChecksums>("organ.spm: section codes", spans.codes, std::move(checksums)),
        std::make_shared<const BlockChecksums>("organ.spm: section lists", spans.lists,
                                               BlockChecksums::of(spans.lists)));
  }
  [[nodiscard]] const spm::codec::CompressedModel& compressed() const noexcept { return compressed_; }
  /// Whether a record of the region has a code in the damaged block.
  [[nodiscard]] bool is_damaged(std::uint32_t region) const {
    return !compressed_.damage(spm::RegionId{region}, compressed_.intervals_of(spm::RegionId{region})).empty();
  }

 private:
  spm::codec::Bytes codes_;
  spm::codec::CompressedModel compressed_;
};

}  // namespace tactus::test_support
