#include "spm/codec/block_checksums.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "spm/codec/region_codec.hpp"
#include "tests/support/damaged_model.hpp"

namespace tactus::spm::codec {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::uint64_t kBlockBits = 8 * BlockChecksums::kBlockBytes;

class BlockChecksumsTest : public testing::Test {
 protected:
  /// Two whole blocks and one of 100 bytes.
  static std::vector<std::uint8_t> bytes() {
    std::vector<std::uint8_t> bytes(2 * BlockChecksums::kBlockBytes + 100);
    for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(i * i >> 3);
    return bytes;
  }
  std::vector<std::uint8_t> bytes_ = bytes();
};

TEST_F(BlockChecksumsTest, ABlockIsDamagedIfOneOfItsBitsHasChanged) {
  const std::vector<std::uint64_t> sound = BlockChecksums::of(bytes_);
  ASSERT_EQ(sound.size(), 3u);
  bytes_[BlockChecksums::kBlockBytes] ^= 1;
  const BlockChecksums checksums{"codes", bytes_, sound};
  EXPECT_THAT(checksums.damage(0, kBlockBits), IsEmpty());
  EXPECT_THAT(checksums.damage(2 * kBlockBits, 2 * kBlockBits + 800), IsEmpty());
  const std::string expected = "codes: the checksum of bytes 65536 to 131071 does not match, the file is damaged";
  EXPECT_EQ(checksums.damage(kBlockBits, kBlockBits + 1), expected);
  EXPECT_EQ(checksums.damage(kBlockBits - 1, kBlockBits + 1), expected) << "the end of a block and the next one";
  EXPECT_EQ(checksums.damage(0, 2 * kBlockBits + 800), expected);
  EXPECT_EQ(checksums.damage(2 * kBlockBits - 1, 2 * kBlockBits), expected) << "checked again";
}

TEST_F(BlockChecksumsTest, TheLastBlockIsShorter) {
  const std::vector<std::uint64_t> sound = BlockChecksums::of(bytes_);
  bytes_.back() ^= 128;
  const BlockChecksums checksums{"lists", bytes_, sound};
  EXPECT_THAT(checksums.damage(0, 2 * kBlockBits), IsEmpty());
  EXPECT_EQ(checksums.damage(2 * kBlockBits, 2 * kBlockBits + 1),
            "lists: the checksum of bytes 131072 to 131171 does not match, the file is damaged");
}

TEST_F(BlockChecksumsTest, BitsAfterTheLastByteAndNoBitsAreNotChecked) {
  const BlockChecksums checksums{"codes", bytes_, {1, 2, 3}};
  EXPECT_THAT(checksums.damage(3 * kBlockBits, 4 * kBlockBits), IsEmpty());
  EXPECT_THAT(checksums.damage(~std::uint64_t{0} - 1, ~std::uint64_t{0}), IsEmpty());
  EXPECT_THAT(checksums.damage(5, 5), IsEmpty());
  EXPECT_THAT(checksums.damage(7, 5), IsEmpty());
  const BlockChecksums none{"codes", {}, {}};
  EXPECT_THAT(none.damage(0, 1), IsEmpty());
}

TEST_F(BlockChecksumsTest, AModelEncodesItsSoundRegionsAndNamesTheDamageOfTheOthers) {
  const CompressedModel& sound = test_support::organ_of_several_blocks().compressed();
  const test_support::DamagedModel damaged{sound};
  std::uint32_t refused = 0;
  for (std::uint32_t region = 0; region < sound.summary().regions; ++region) {
    const std::vector<Interval> list = sound.intervals_of(RegionId{region});
    const Result<Bytes> message = encode_region(damaged.compressed(), RegionId{region}, list);
    if (message) {
      ASSERT_EQ(*message, *encode_region(sound, RegionId{region}, list)) << region;
      continue;
    }
    ++refused;
    ASSERT_THAT(message.error().text, HasSubstr("organ.spm: section codes: the checksum of bytes 65536 to 131071"));
  }
  EXPECT_GT(refused, 0u);
  EXPECT_LT(refused, sound.summary().regions);
  EXPECT_THAT(damaged.compressed().damage(), HasSubstr("bytes 65536 to 131071"));
  EXPECT_THAT(sound.damage(), IsEmpty());
}

}  // namespace
}  // namespace tactus::spm::codec
