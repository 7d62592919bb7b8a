// A store of regions as they came, against sets of records: what it says is here, is free or leaves, and whether a
// cache that gets its regions from it shows the model's own records.
#include "spm/codec/compressed_cache.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <random>
#include <set>

#include "spm/codec/region_codec.hpp"
#include "spm/offline/build.hpp"
#include "spm/offline/generate.hpp"
#include "tests/support/hrtc_model.hpp"
#include "tests/support/loaded_records.hpp"

namespace tactus::spm::codec {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Status = CompressedCache::PutResult::Status;

constexpr std::uint64_t kSeed = 20261121;
constexpr std::uint32_t kBlocks = 1 << 14;

class CompressedCacheTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    built_ = new offline::BuiltModel{offline::build_model(offline::generate(offline::Shape::kOrgan, 12000))};
    encoded_ = new EncodedModel{built_->model()};
  }
  static void TearDownTestSuite() {
    delete encoded_;
    delete built_;
  }
  CompressedCacheTest() { store_.admit(ObjectIndex{0}, summary(), encoded_->compressed().tables()); }

  static const ModelSummary& summary() { return encoded_->compressed().summary(); }
  static std::uint32_t regions() { return summary().regions; }
  [[nodiscard]] static std::set<std::uint32_t> records_of(std::uint32_t region) {
    std::set<std::uint32_t> records;
    for (const spm::Interval& run : encoded_->compressed().intervals_of(RegionId{region}))
      for (std::uint32_t r = run.first; r != run.first + run.count; ++r) records.insert(r);
    return records;
  }
  /// With the records of its list that are not in `have`.
  [[nodiscard]] static Bytes message(std::uint32_t region, const std::set<std::uint32_t>& have) {
    std::vector<spm::Interval> missing;
    for (const std::uint32_t r : records_of(region)) {
      if (have.count(r) != 0) continue;
      if (!missing.empty() && missing.back().first + missing.back().count == r)
        ++missing.back().count;
      else
        missing.push_back({r, 1});
    }
    return encode_region(encoded_->compressed(), RegionId{region}, missing);
  }
  CompressedCache::PutResult put(std::uint32_t region, const std::set<std::uint32_t>& have = {}) {
    return store_.put(kObject, RegionId{region}, message(region, have));
  }

  static constexpr ObjectIndex kObject{0};
  static offline::BuiltModel* built_;
  static EncodedModel* encoded_;
  CompressedCache store_{kBlocks};
};
offline::BuiltModel* CompressedCacheTest::built_ = nullptr;
EncodedModel* CompressedCacheTest::encoded_ = nullptr;

TEST_F(CompressedCacheTest, ACacheFilledFromItHoldsTheModelsRecords) {
  test_support::HrtcModel hrtc{built_->model(), PoolSettings::for_slots(2 * summary().parts)};
  for (std::uint32_t region = 0; region < regions(); ++region) ASSERT_EQ(put(region).status, Status::kStored) << region;
  for (std::uint32_t region = 0; region < regions(); ++region) {
    RegionList list;
    const RegionData& data = store_.get(kObject, RegionId{region}, hrtc.cache());
    ASSERT_EQ(hrtc.cache().accept(hrtc.object(), data, list), AcceptResult::kAccepted) << region;
    ASSERT_THAT(store_.get(kObject, RegionId{region}, hrtc.cache()).parts, IsEmpty()) << "all are in the cache";
  }
  EXPECT_EQ(test_support::loaded_difference(built_->model(), hrtc.pool()), "");
  EXPECT_THAT(store_.violations(), IsEmpty());
}

TEST_F(CompressedCacheTest, CountsWhatIsFreeAndWhatLeavesAsSetsOfRecordsDo) {
  struct Kept {
    std::set<std::uint32_t> records;
    std::uint32_t list_blocks;
    bool leaves;
  };
  std::map<std::uint32_t, Kept> kept;
  std::map<std::uint32_t, std::uint32_t> record_blocks;
  const auto all = [&](bool staying_only) {
    std::set<std::uint32_t> records;
    for (const auto& [region, is] : kept)
      if (!staying_only || !is.leaves) records.insert(is.records.begin(), is.records.end());
    return records;
  };
  const auto blocks = [&](const std::set<std::uint32_t>& records, bool staying_only) {
    std::uint32_t sum = 0;
    for (const std::uint32_t r : records) sum += record_blocks.at(r);
    for (const auto& [region, is] : kept)
      if (!staying_only || !is.leaves) sum += is.list_blocks;
    return sum;
  };
  for (std::uint32_t region = 0; region < regions(); ++region) {
    std::vector<RecordCode> codes;
    ASSERT_TRUE(decode_region(message(region, {}), summary(), encoded_->compressed().tables(), &codes));
    const std::set<std::uint32_t> records = records_of(region);
    ASSERT_EQ(codes.size(), records.size());
    auto record = records.begin();
    constexpr std::uint64_t kAnchor = 28, kBlock = 128;  // bits
    for (const RecordCode& code : codes)
      record_blocks[*record++] = static_cast<std::uint32_t>((kAnchor + code.bits + kBlock - 1) / kBlock);
  }

  std::mt19937_64 random{kSeed};
  int left = 0, taken_back = 0, returned = 0, left_out = 0;
  std::set<std::uint32_t> seen;
  for (int step = 0; step < 800; ++step) {
    const auto region = static_cast<std::uint32_t>(random() % regions());
    const auto at = kept.find(region);
    if (at == kept.end()) {
      const std::set<std::uint32_t> staying = all(true);
      const std::set<std::uint32_t> have =
          random() % 8 == 0 ? std::set<std::uint32_t>{} : all(random() % 2 == 0);  // as the host knows it
      const std::uint32_t free = store_.blocks_free();
      const CompressedCache::PutResult put = this->put(region, have);
      ASSERT_EQ(put.status, Status::kStored) << "step " << step << ", seed " << kSeed;
      EXPECT_EQ(free - store_.blocks_free(), put.blocks);
      std::uint32_t again = 0, fresh = 0, repeated = 0, published = 0;
      const std::set<std::uint32_t> here = all(false);
      for (const std::uint32_t r : records_of(region)) {
        if (have.count(r) == 0) again += static_cast<std::uint32_t>(seen.count(r));
        if (have.count(r) == 0) repeated += static_cast<std::uint32_t>(here.count(r));
        if (have.count(r) == 0) published += static_cast<std::uint32_t>(staying.count(r));
        if (here.count(r) == 0) fresh += record_blocks.at(r);
        seen.insert(r);
      }
      EXPECT_EQ(put.returned, again);
      EXPECT_EQ(put.repeated, repeated);
      EXPECT_EQ(put.published, published);
      left_out += put.repeated > put.published ? 1 : 0;
      returned += put.returned > 0 ? 1 : 0;
      kept[region] = {records_of(region), put.blocks - fresh, false};
    } else if (at->second.leaves && random() % 2 == 0) {
      store_.reinstate(kObject, RegionId{region});
      at->second.leaves = false;
      ++taken_back;
    } else if (at->second.leaves) {
      store_.evict(kObject, RegionId{region});
      kept.erase(at);
      ++left;
    } else {
      store_.retire(kObject, RegionId{region});
      at->second.leaves = true;
    }
    const std::uint32_t used = blocks(all(false), false), staying = blocks(all(true), true);
    ASSERT_EQ(store_.blocks_free(), kBlocks - used) << "step " << step << ", seed " << kSeed;
    ASSERT_EQ(store_.blocks_retired(), used - staying) << "step " << step << ", seed " << kSeed;
    if (step % 100 == 0) {
      ASSERT_THAT(store_.violations(), IsEmpty()) << "step " << step << ", seed " << kSeed;
    }
  }
  EXPECT_GT(left, 100);
  EXPECT_GT(taken_back, 100);
  EXPECT_GT(returned, 100);
  EXPECT_GT(left_out, 50);
}

TEST_F(CompressedCacheTest, AMessageThatCountsOnWhatIsNotHereIsIncompleteAndChangesNothing) {
  ASSERT_EQ(put(0).status, Status::kStored);
  std::set<std::uint32_t> have = records_of(0);
  std::uint32_t other = 1;
  while (records_of(other) == have) ++other;
  have.insert(*records_of(other).rbegin());

  EXPECT_EQ(put(other, have).status, Status::kIncomplete);

  EXPECT_FALSE(store_.holds(kObject, RegionId{other}));
  EXPECT_THAT(store_.violations(), IsEmpty());
}

TEST_F(CompressedCacheTest, WhatDoesNotFitIsRefusedWithWhatItNeedsAndChangesNothing) {
  std::uint32_t region = 0;
  CompressedCache small{1000};
  small.admit(kObject, summary(), encoded_->compressed().tables());
  CompressedCache::PutResult put;
  do put = small.put(kObject, RegionId{region}, message(region, {}));
  while (put.status == Status::kStored && ++region < regions());

  EXPECT_EQ(put.status, Status::kFull);
  EXPECT_GT(put.blocks, small.blocks_free());
  EXPECT_FALSE(small.holds(kObject, RegionId{region}));
  EXPECT_THAT(small.violations(), IsEmpty());
  for (std::uint32_t kept = 0; kept < region; ++kept) {
    small.retire(kObject, RegionId{kept});
    small.evict(kObject, RegionId{kept});
  }
  EXPECT_EQ(small.blocks_free(), 1000u);
  EXPECT_EQ(small.blocks_retired(), 0u);
}

TEST_F(CompressedCacheTest, WhatIsNoMessageOfThatRegionIsRefusedInWords) {
  EXPECT_THAT(store_.put(kObject, RegionId{1}, message(2, {})).error, HasSubstr("contains region 2"));
  Bytes cut = message(1, {});
  cut.resize(cut.size() / 2);
  EXPECT_EQ(store_.put(kObject, RegionId{1}, cut).status, Status::kMalformed);
  ASSERT_EQ(put(1).status, Status::kStored);
  EXPECT_EQ(put(1).status, Status::kAlreadyHeld);
}

}  // namespace
}  // namespace tactus::spm::codec
