// Compares the counters of a compressed cache with sets of records, and the records that it returns with the model.
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
#include "tests/support/random_model.hpp"

namespace tactus::spm::codec {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Status = CompressedCache::PutResult::Status;

constexpr std::uint64_t kCacheSeed = 20261121;
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
  CompressedCacheTest() { compressed_cache_.admit(ObjectIndex{0}, summary(), encoded_->compressed().tables()); }

  static const ModelSummary& summary() { return encoded_->compressed().summary(); }
  static std::uint32_t regions() { return summary().regions; }
  [[nodiscard]] static std::set<std::uint32_t> records_of(std::uint32_t region) {
    std::set<std::uint32_t> records;
    for (const spm::Interval& interval : encoded_->compressed().intervals_of(RegionId{region}))
      for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r) records.insert(r);
    return records;
  }
  /// Returns the message of a host for `region`, with the listed records that are not in `present`.
  [[nodiscard]] static Bytes message(std::uint32_t region, const std::set<std::uint32_t>& present = {}) {
    std::vector<spm::Interval> missing;
    for (const std::uint32_t record : records_of(region)) {
      if (present.count(record) != 0) continue;
      if (!missing.empty() && missing.back().first + missing.back().count == record)
        ++missing.back().count;
      else
        missing.push_back({record, 1});
    }
    return *encode_region(encoded_->compressed(), RegionId{region}, missing);
  }
  CompressedCache::PutResult put(std::uint32_t region, const std::set<std::uint32_t>& present = {}) {
    return compressed_cache_.put(kObject, RegionId{region}, message(region, present));
  }

  static constexpr ObjectIndex kObject{0};
  static offline::BuiltModel* built_;
  static EncodedModel* encoded_;
  CompressedCache compressed_cache_{kBlocks};
};
offline::BuiltModel* CompressedCacheTest::built_ = nullptr;
EncodedModel* CompressedCacheTest::encoded_ = nullptr;

TEST_F(CompressedCacheTest, RestoresAllRecordsOfTheModel) {
  test_support::HrtcModel hrtc{built_->model(), PoolSettings::for_slots(2 * summary().parts)};
  for (std::uint32_t region = 0; region < regions(); ++region) ASSERT_EQ(put(region).status, Status::kStored) << region;
  for (std::uint32_t region = 0; region < regions(); ++region) {
    RegionList list;
    const RegionData* data = compressed_cache_.get(kObject, RegionId{region});
    ASSERT_NE(data, nullptr);
    ASSERT_EQ(hrtc.accept(*data, list), AcceptResult::kAccepted) << region;
    compressed_cache_.mark_loaded(kObject, RegionId{region});
    ASSERT_THAT(compressed_cache_.get(kObject, RegionId{region})->parts, IsEmpty()) << "all records are loaded";
  }
  EXPECT_EQ(test_support::loaded_difference(built_->model(), hrtc.pool()), "");
  EXPECT_THAT(compressed_cache_.violations(), IsEmpty());
}

/// The contents of a compressed cache as plain sets of records, from which all its counters but one can be computed.
/// ReceivedRecords computes the number of returned records.
class ReferenceCache {
 public:
  struct StoredRegion {
    std::set<std::uint32_t> records;
    std::uint32_t list_blocks;
    bool retired;
  };

  /// Returns the records of all regions, or only of those that are not retired.
  [[nodiscard]] std::set<std::uint32_t> records(bool include_retired) const {
    std::set<std::uint32_t> all;
    for (const auto& [region, stored] : regions)
      if (include_retired || !stored.retired) all.insert(stored.records.begin(), stored.records.end());
    return all;
  }
  [[nodiscard]] std::uint32_t blocks(bool include_retired) const {
    std::uint32_t sum = 0;
    for (const std::uint32_t record : records(include_retired)) sum += record_blocks.at(record);
    for (const auto& [region, stored] : regions)
      if (include_retired || !stored.retired) sum += stored.list_blocks;
    return sum;
  }

  std::map<std::uint32_t, StoredRegion> regions;
  std::map<std::uint32_t, std::uint32_t> record_blocks;
};

class CompressedCacheCounters : public CompressedCacheTest {
 protected:
  void SetUp() override {
    constexpr std::uint64_t kAnchorBits = 30, kBlockBits = 128;
    for (std::uint32_t region = 0; region < regions(); ++region) {
      const Result<RegionCodes> checked =
          check_region(message(region), summary(), encoded_->compressed().tables(), kBlocks);
      ASSERT_TRUE(checked);
      const std::set<std::uint32_t> records = records_of(region);
      ASSERT_EQ(checked->codes.size(), records.size());
      auto record = records.begin();
      for (const RecordCode& code : checked->codes)
        reference_.record_blocks[*record++] =
            static_cast<std::uint32_t>((kAnchorBits + code.bits + kBlockBits - 1) / kBlockBits);
    }
  }

  /// Stores a region that is not present, and compares the counters of the result.
  void put_and_compare(std::uint32_t region) {
    const std::set<std::uint32_t> not_retired = reference_.records(false), stored = reference_.records(true);
    // The records that the host counts as present: none, all that are not retired, or all.
    std::set<std::uint32_t> present;
    if (random_() % 8 != 0) present = random_() % 2 == 0 ? not_retired : stored;
    const std::uint32_t free_before = compressed_cache_.blocks_free();
    const CompressedCache::PutResult result = put(region, present);
    ASSERT_EQ(result.status, Status::kStored);
    EXPECT_EQ(free_before - compressed_cache_.blocks_free(), result.blocks);
    std::uint32_t returned = 0, repeated = 0, repeated_unretired = 0, new_blocks = 0;
    for (const std::uint32_t record : records_of(region)) {
      if (present.count(record) == 0) {
        returned += received_.add(RecordId{record});
        repeated += static_cast<std::uint32_t>(stored.count(record));
        repeated_unretired += static_cast<std::uint32_t>(not_retired.count(record));
      }
      if (stored.count(record) == 0) new_blocks += reference_.record_blocks.at(record);
    }
    EXPECT_EQ(result.returned, returned);
    EXPECT_EQ(result.repeated, repeated);
    EXPECT_EQ(result.repeated_unretired, repeated_unretired);
    with_retired_records_ += result.repeated > result.repeated_unretired ? 1 : 0;
    with_returned_records_ += result.returned > 0 ? 1 : 0;
    reference_.regions[region] = {records_of(region), result.blocks - new_blocks, false};
  }

  ReferenceCache reference_;
  ReceivedRecords received_;
  std::mt19937_64 random_{kCacheSeed};
  int with_retired_records_ = 0, with_returned_records_ = 0;
};

TEST_F(CompressedCacheCounters, AgreeWithSetsOfRecords) {
  int evicted = 0, reinstated = 0;
  for (int step = 0; step < 800; ++step) {
    SCOPED_TRACE("step " + std::to_string(step) + ", seed " + std::to_string(kCacheSeed));
    const auto number = static_cast<std::uint32_t>(random_() % regions());
    const RegionId region{number};
    const auto stored = reference_.regions.find(number);
    if (stored == reference_.regions.end()) {
      ASSERT_NO_FATAL_FAILURE(put_and_compare(number));
    } else if (stored->second.retired && random_() % 2 == 0) {
      compressed_cache_.reinstate(kObject, region);
      stored->second.retired = false;
      ++reinstated;
    } else if (stored->second.retired) {
      compressed_cache_.evict(kObject, region);
      reference_.regions.erase(stored);
      ++evicted;
    } else {
      compressed_cache_.retire(kObject, region);
      stored->second.retired = true;
    }
    const std::uint32_t used = reference_.blocks(true);
    ASSERT_EQ(compressed_cache_.blocks_free(), kBlocks - used);
    ASSERT_EQ(compressed_cache_.blocks_retired(), used - reference_.blocks(false));
    if (step % 100 == 0) {
      ASSERT_THAT(compressed_cache_.violations(), IsEmpty());
    }
  }
  EXPECT_GT(evicted, 100);
  EXPECT_GT(reinstated, 100);
  EXPECT_GT(with_returned_records_, 100);
  EXPECT_GT(with_retired_records_, 50);
}

TEST_F(CompressedCacheTest, AMessageThatLacksARecordIsIncompleteAndChangesNothing) {
  ASSERT_EQ(put(0).status, Status::kStored);
  std::set<std::uint32_t> present = records_of(0);
  std::uint32_t other = 1;
  while (records_of(other) == present) ++other;
  present.insert(*records_of(other).rbegin());  // this record is not in the cache

  EXPECT_EQ(put(other, present).status, Status::kIncomplete);

  EXPECT_FALSE(compressed_cache_.holds(kObject, RegionId{other}));
  EXPECT_THAT(compressed_cache_.violations(), IsEmpty());
}

TEST_F(CompressedCacheTest, ARegionThatDoesNotFitIsRefusedWithTheBlocksThatItNeedsAndChangesNothing) {
  std::uint32_t region = 0;
  CompressedCache small{1000};
  small.admit(kObject, summary(), encoded_->compressed().tables());
  CompressedCache::PutResult put;
  do put = small.put(kObject, RegionId{region}, message(region));
  while (put.status == Status::kStored && ++region < regions());

  EXPECT_EQ(put.status, Status::kFull);
  EXPECT_GT(put.blocks, small.blocks_free());
  EXPECT_FALSE(small.holds(kObject, RegionId{region}));
  EXPECT_THAT(small.violations(), IsEmpty());
  for (std::uint32_t stored = 0; stored < region; ++stored) {
    small.retire(kObject, RegionId{stored});
    small.evict(kObject, RegionId{stored});
  }
  EXPECT_EQ(small.blocks_free(), 1000u);
  EXPECT_EQ(small.blocks_retired(), 0u);
}

TEST_F(CompressedCacheTest, AListWithMoreRecordsThanTheCacheHasBlocksIsRefusedBeforeItsRecordsAreRead) {
  const auto listed = static_cast<std::uint32_t>(records_of(0).size());
  Bytes cut = message(0);
  cut.resize(cut.size() - 1);
  const auto put = [&](std::uint32_t blocks) {
    CompressedCache cache{blocks};
    cache.admit(kObject, summary(), encoded_->compressed().tables());
    return cache.put(kObject, RegionId{0}, cut);
  };

  EXPECT_EQ(put(listed).status, Status::kMalformed) << "the message is truncated";
  const CompressedCache::PutResult small = put(listed - 1);
  EXPECT_EQ(small.status, Status::kFull);
  EXPECT_EQ(small.blocks, listed) << "more than the cache has";
}

TEST_F(CompressedCacheTest, AListWithManyIntervalsIsRefusedWithoutMemoryForThem) {
  BitWriter out;
  out.put(0, 32);
  put_length_prefixed(out, kBlocks + 1);
  Bytes message = out.take();
  message.resize(1 << 14);

  const Result<RegionCodes> checked = check_region(message, summary(), encoded_->compressed().tables(), kBlocks);

  ASSERT_TRUE(checked);
  EXPECT_TRUE(checked->is_too_long);
  EXPECT_EQ(checked->list.capacity(), 0u);
}

/// A model in which most records have a code in the explicit form.
class ExplicitRecords : public ::testing::Test {
 protected:
  [[nodiscard]] std::vector<spm::Interval> list_of(std::uint32_t region) const {
    return encoded_.compressed().intervals_of(RegionId{region});
  }
  /// Returns the listed records of `region` that are not in the list of `other`.
  [[nodiscard]] std::vector<spm::Interval> difference(std::uint32_t region, std::uint32_t other) const {
    std::vector<bool> present(owned_.summary.records, false);
    for (const spm::Interval& interval : list_of(other))
      std::fill_n(present.begin() + interval.first, interval.count, true);
    std::vector<spm::Interval> missing;
    for (const spm::Interval& interval : list_of(region))
      for (std::uint32_t r = interval.first; r != interval.first + interval.count; ++r) {
        if (present[r]) continue;
        if (!missing.empty() && missing.back().first + missing.back().count == r)
          ++missing.back().count;
        else
          missing.push_back({r, 1});
      }
    return missing;
  }
  [[nodiscard]] Bytes message(std::uint32_t region, const std::vector<spm::Interval>& sent) const {
    return *encode_region(encoded_.compressed(), RegionId{region}, sent);
  }
  [[nodiscard]] std::uint32_t parts_in(const Bytes& message) const {
    return static_cast<std::uint32_t>(
        decode_region(message, owned_.summary, encoded_.compressed().tables())->parts.size());
  }

  OwnedModel owned_ = test_support::random_model(kCacheSeed, 300, 3);
  EncodedModel encoded_{owned_.model()};
};

// A host states the number of parts of the model. A message with more parts is malformed, but a region can have the
// records of several messages.
TEST_F(ExplicitRecords, ARegionOfTwoMessagesCanHaveMorePartsThanTheHostStates) {
  std::uint32_t parts = 0, excess = 0;
  ModelSummary stated = owned_.summary;
  RegionId a{}, b{};
  for (std::uint32_t i = 0; i < owned_.summary.regions; ++i)
    for (std::uint32_t k = 0; k < owned_.summary.regions; ++k) {
      const std::uint32_t all = parts_in(message(k, list_of(k)));
      const std::uint32_t limit = std::max(parts_in(message(i, list_of(i))), parts_in(message(k, difference(k, i))));
      if (all < limit || all - limit <= excess) continue;
      parts = all;
      excess = all - limit;
      stated.parts = limit;
      a = RegionId{i};
      b = RegionId{k};
    }
  ASSERT_GT(excess, 10u);
  const Bytes first = message(index(a), list_of(index(a))), second = message(index(b), difference(index(b), index(a)));
  CompressedCache cache{kBlocks};
  cache.admit(ObjectIndex{0}, stated, encoded_.compressed().tables());
  ASSERT_EQ(cache.put(ObjectIndex{0}, a, first).status, Status::kStored);
  ASSERT_EQ(cache.put(ObjectIndex{0}, b, second).status, Status::kStored);

  const RegionData* data = cache.get(ObjectIndex{0}, b);

  ASSERT_NE(data, nullptr);
  EXPECT_EQ(data->parts.size(), parts);
}

TEST_F(CompressedCacheTest, RefusesTheMessageOfAnotherRegionATruncatedMessageAndARepeatedMessage) {
  EXPECT_THAT(compressed_cache_.put(kObject, RegionId{1}, message(2)).error, HasSubstr("contains region 2"));
  Bytes cut = message(1);
  cut.resize(cut.size() / 2);
  EXPECT_EQ(compressed_cache_.put(kObject, RegionId{1}, cut).status, Status::kMalformed);
  ASSERT_EQ(put(1).status, Status::kStored);
  EXPECT_EQ(put(1).status, Status::kAlreadyHeld);
}

}  // namespace
}  // namespace tactus::spm::codec
