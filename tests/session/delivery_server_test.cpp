#include "session/delivery_server.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "spm/codec/model_codec.hpp"
#include "spm/codec/region_codec.hpp"
#include "tests/support/random_model.hpp"

namespace tactus::session {
namespace {

using test_support::OwnedModel;
using test_support::random_model;

constexpr std::uint64_t kSession = 1, kHost = 10, kHrtc = 20, kOtherHrtc = 21, kObject = 30;

class DeliveryServerTest : public testing::Test {
 protected:
  DeliveryServerTest() : owned_{random_model(1, 2000, 3)}, model_{owned_.view()}, server_{{kSession, kHost, 5, 0}} {
    server_.add(kObject, encoded_.coded());
  }

  Demand demand(std::uint32_t epoch, std::vector<std::uint32_t> wanted, std::uint64_t hrtc = kHrtc) {
    Demand d;
    d.origin = {kSession, hrtc, 7, ++time_};
    d.object_id = kObject;
    d.digest = model_.summary.digest;
    d.serving_host = kHost;
    d.epoch = epoch;
    for (const std::uint32_t region : wanted) d.wanted.push_back({region, static_cast<std::uint32_t>(d.wanted.size())});
    d.stream_incarnation = 5;
    d.credit = 1u << 20;
    return d;
  }

  std::vector<BulkChunk> drain(std::size_t limit = 100'000) {
    std::vector<BulkChunk> chunks;
    while (chunks.size() < limit) {
      std::optional<Outgoing> out = server_.next(0);
      if (!out) break;
      chunks.push_back(std::move(out->chunk));
    }
    return chunks;
  }

  /// The regions in the order in which their last chunks went, each with the records sent.
  std::vector<std::pair<std::uint32_t, std::set<std::uint32_t>>> regions_in(const std::vector<BulkChunk>& chunks) {
    std::vector<std::pair<std::uint32_t, std::set<std::uint32_t>>> regions;
    std::vector<std::uint8_t> bytes;
    for (const BulkChunk& chunk : chunks) {
      if (chunk.kind != BulkKind::kRegion) continue;
      if (chunk.part == 0) bytes.clear();
      bytes.insert(bytes.end(), chunk.payload.begin(), chunk.payload.end());
      if (chunk.part + 1 != chunk.parts) continue;
      const auto data = spm::codec::decode_region(bytes, model_.summary, encoded_.coded().tables());
      if (!data) {
        ADD_FAILURE() << data.error().text;
        continue;
      }
      std::set<std::uint32_t> records;
      for (const spm::Run& run : data->sent) {
        for (std::uint32_t r = run.first; r != run.first + run.count; ++r) records.insert(r);
      }
      regions.emplace_back(chunk.region, records);
    }
    return regions;
  }

  std::set<std::uint32_t> list_of(std::uint32_t region) const {
    std::set<std::uint32_t> records;
    for (const spm::Run& run : model_.runs_of(spm::RegionId{region})) {
      for (std::uint32_t r = run.first; r != run.first + run.count; ++r) records.insert(r);
    }
    return records;
  }

  OwnedModel owned_;
  spm::Model model_;
  spm::codec::EncodedModel encoded_{model_};
  DeliveryServer server_;
  std::int64_t time_ = 0;
};

TEST_F(DeliveryServerTest, SendsWhatIsWantedSoonestFirstAndEveryRecordOnce) {
  server_.on_demand(demand(1, {4, 2, 7}));

  const auto regions = regions_in(drain());

  ASSERT_EQ(regions.size(), 3u);
  std::set<std::uint32_t> here;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::uint32_t expected = std::vector<std::uint32_t>{4, 2, 7}[i];
    EXPECT_EQ(regions[i].first, expected);
    std::set<std::uint32_t> missing;
    for (const std::uint32_t r : list_of(expected)) {
      if (here.insert(r).second) missing.insert(r);
    }
    EXPECT_EQ(regions[i].second, missing);
  }
}

TEST_F(DeliveryServerTest, CountsOnWhatTheDemandSaysIsThere) {
  Demand d = demand(1, {3});
  d.have = {{0, 2}};
  server_.on_demand(d);

  const auto regions = regions_in(drain());

  ASSERT_EQ(regions.size(), 1u);
  const std::set<std::uint32_t> first = list_of(0), second = list_of(1);
  for (const std::uint32_t r : list_of(3)) {
    EXPECT_EQ(regions[0].second.count(r), first.count(r) + second.count(r) == 0 ? 1u : 0u) << "record " << r;
  }
}

TEST_F(DeliveryServerTest, SendsAgainWhatWasPassedAndNotTaken) {
  server_.on_demand(demand(1, {3}));
  const std::vector<BulkChunk> sent = drain();
  Demand d = demand(1, {3});
  d.received = sent.back().sequence - 1;
  server_.on_demand(d);
  EXPECT_THAT(drain(), testing::IsEmpty()) << "its last chunk has not been passed";

  d = demand(1, {3});
  d.received = sent.back().sequence;
  server_.on_demand(d);

  EXPECT_EQ(regions_in(drain()).size(), 1u);
}

TEST_F(DeliveryServerTest, CountsOnNothingThatWasUnderWayWhenSomethingWasLost) {
  server_.on_demand(demand(1, {0, 1, 2}));
  Demand lost = demand(2, {0, 1, 2, 3});
  for (const BulkChunk& chunk : drain())
    if (chunk.region == 0) lost.received = chunk.sequence;  // refused; 1 and 2, which may count on it, are on their way

  server_.on_demand(lost);
  const auto regions = regions_in(drain());

  ASSERT_EQ(regions.size(), 2u);
  EXPECT_EQ(regions[0].first, 0u);
  EXPECT_EQ(regions[0].second, list_of(0)) << "whole, whatever 1 and 2 have of it";
  EXPECT_EQ(regions[1].first, 3u);
  std::set<std::uint32_t> missing;
  for (const std::uint32_t r : list_of(3))
    if (list_of(0).count(r) == 0) missing.insert(r);
  EXPECT_EQ(regions[1].second, missing);
}

TEST_F(DeliveryServerTest, DoesNotCountOnAnIncarnationOfItsStreamThatIsNotThis) {
  server_.on_demand(demand(1, {3}));
  const std::vector<BulkChunk> sent = drain();

  Demand d = demand(2, {3});
  d.received = sent.back().sequence;
  d.stream_incarnation = 4;
  server_.on_demand(d);

  EXPECT_THAT(regions_in(drain()), testing::IsEmpty());
}

TEST_F(DeliveryServerTest, AnOmittedRegionIsNotFinished) {
  server_.on_demand(demand(1, {3, 5}));
  const std::vector<BulkChunk> begun = drain(1);
  ASSERT_GT(begun[0].parts, 1u);

  server_.on_demand(demand(2, {5}));

  const std::vector<BulkChunk> chunks = drain();
  const auto regions = regions_in(chunks);
  ASSERT_EQ(regions.size(), 1u);
  EXPECT_EQ(regions[0].first, 5u);
  EXPECT_EQ(regions[0].second, list_of(5)) << "counted on a region that was never finished";
  EXPECT_EQ(server_.counters().messages_dropped, 1u);
}

TEST_F(DeliveryServerTest, AMessageThatCountsOnARetiredRegionIsPlannedAnew) {
  Demand d = demand(1, {3});
  d.have = {{0, 2}};
  server_.on_demand(d);
  const std::vector<BulkChunk> begun = drain(1);
  ASSERT_GT(begun[0].parts, 1u);

  server_.on_demand(demand(2, {3}));

  const std::vector<BulkChunk> chunks = drain();
  const auto regions = regions_in(chunks);
  ASSERT_EQ(regions.size(), 1u);
  EXPECT_EQ(regions[0].second, list_of(3));
  for (const BulkChunk& chunk : chunks) EXPECT_EQ(chunk.epoch, 2u);
}

TEST_F(DeliveryServerTest, StaysWithinTheCredit) {
  Demand d = demand(1, {0, 1, 2, 3, 4, 5});
  d.credit = 3 * kMaxPayload;
  server_.on_demand(d);

  const std::vector<BulkChunk> first = drain();

  EXPECT_EQ(first.size(), 3u);
  EXPECT_LE(server_.bytes_under_way(kHrtc), d.credit);
  d = demand(1, {0, 1, 2, 3, 4, 5});
  d.credit = 3 * kMaxPayload;
  d.received = first[0].sequence;
  server_.on_demand(d);
  EXPECT_EQ(drain().size(), 1u);
}

TEST_F(DeliveryServerTest, TellsAnEpochThatBringsNothingToSendOnce) {
  server_.on_demand(demand(4, {}));

  const std::vector<BulkChunk> chunks = drain();

  ASSERT_EQ(chunks.size(), 1u);
  EXPECT_EQ(chunks[0].kind, BulkKind::kEcho);
  EXPECT_EQ(chunks[0].epoch, 4u);
  server_.on_demand(demand(4, {}));
  EXPECT_THAT(drain(), testing::IsEmpty()) << "a keep-alive is no news";
}

TEST_F(DeliveryServerTest, TellsANewEpochEvenWithoutCredit) {
  Demand d = demand(1, {0, 1, 2});
  d.credit = kMaxPayload;
  server_.on_demand(d);
  drain();
  d = demand(2, {0, 1, 2});
  d.credit = kMaxPayload;
  server_.on_demand(d);

  const std::vector<BulkChunk> chunks = drain();

  ASSERT_EQ(chunks.size(), 1u);
  EXPECT_EQ(chunks[0].kind, BulkKind::kEcho);
  EXPECT_EQ(chunks[0].epoch, 2u);
}

TEST_F(DeliveryServerTest, SendsTheBaseMeshFirstAndAgainWhenItWasPassed) {
  Demand d = demand(1, {3});
  d.need_base = true;
  server_.on_demand(d);
  const std::vector<BulkChunk> base = drain();
  ASSERT_FALSE(base.empty());
  std::size_t bytes = 0;
  for (const BulkChunk& chunk : base) {
    EXPECT_EQ(chunk.kind, BulkKind::kBase);
    bytes += chunk.payload.size();
  }
  EXPECT_EQ(bytes, server_.base_bytes(kObject));

  d = demand(1, {3});
  d.need_base = true;
  d.received = base.back().sequence;
  server_.on_demand(d);
  EXPECT_EQ(drain().size(), base.size());

  server_.on_demand(demand(2, {3}));
  EXPECT_EQ(regions_in(drain()).size(), 1u);
}

TEST_F(DeliveryServerTest, IsSilentWhenAnotherHostServes) {
  server_.on_demand(demand(1, {3}));
  drain(1);
  Demand d = demand(2, {3});
  d.serving_host = 11;
  server_.on_demand(d);
  EXPECT_THAT(drain(), testing::IsEmpty());

  server_.on_demand(demand(1, {3}));
  EXPECT_THAT(drain(), testing::IsEmpty()) << "an older demand must not bring it back";

  server_.on_demand(demand(3, {3}));
  EXPECT_EQ(regions_in(drain()).at(0).second, list_of(3));
}

TEST_F(DeliveryServerTest, SharesChunkByChunkBetweenControllers) {
  server_.on_demand(demand(1, {0, 1, 2, 3}));
  server_.on_demand(demand(1, {3, 2, 1, 0}, kOtherHrtc));

  const std::vector<BulkChunk> chunks = drain(10);

  ASSERT_EQ(chunks.size(), 10u);
  for (std::size_t i = 1; i < 10; ++i) EXPECT_NE(chunks[i].hrtc, chunks[i - 1].hrtc) << "chunk " << i;
}

TEST_F(DeliveryServerTest, ABlockedControllerGetsNothingAndHoldsNobodyUp) {
  server_.on_demand(demand(1, {0}));
  server_.on_demand(demand(1, {0}, kOtherHrtc));

  const auto not_to_first = [](std::uint64_t hrtc) { return hrtc != kHrtc; };
  const std::optional<Outgoing> first = server_.next(0, not_to_first);
  const std::optional<Outgoing> second = server_.next(0, not_to_first);

  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->hrtc, kOtherHrtc);
  EXPECT_EQ(second->hrtc, kOtherHrtc);
  EXPECT_FALSE(server_.next(0, [](std::uint64_t) { return false; }));
}

TEST_F(DeliveryServerTest, ANewIncarnationOfAControllerStartsFromNothing) {
  server_.on_demand(demand(9, {3}));
  const std::vector<BulkChunk> before = drain();
  Demand d = demand(1, {3});
  d.origin.incarnation = 8;
  server_.on_demand(d);

  const std::vector<BulkChunk> after = drain();

  EXPECT_EQ(regions_in(after).at(0).second, list_of(3));
  EXPECT_GT(after.front().sequence, before.back().sequence) << "the stream counts on";
  EXPECT_EQ(server_.on_demand(demand(10, {3})), DeliveryServer::DemandResult::kNotNewer) << "of the old incarnation";
}

TEST_F(DeliveryServerTest, AControllerThatComesBackHearsHigherSequences) {
  server_.on_demand(demand(1, {3}));
  const std::vector<BulkChunk> before = drain();
  server_.on_hrtc_gone(kHrtc);
  EXPECT_FALSE(server_.next(0));

  server_.on_demand(demand(1, {3}));

  const std::vector<BulkChunk> after = drain();
  ASSERT_FALSE(after.empty());
  EXPECT_GT(after.front().sequence, before.back().sequence);
}

TEST_F(DeliveryServerTest, RefusesDemandsThatMakeNoSense) {
  using Result = DeliveryServer::DemandResult;
  const std::uint32_t regions = model_.summary.regions;
  Demand d = demand(1, {regions});
  EXPECT_EQ(server_.on_demand(d), Result::kMalformed);
  d = demand(1, {});
  d.have = {{5, 0xffffffffu}};
  EXPECT_EQ(server_.on_demand(d), Result::kMalformed);
  d.have = {{5, 1}, {4, 1}};
  EXPECT_EQ(server_.on_demand(d), Result::kMalformed);
  d.have = {{4, 1}, {5, 1}};
  EXPECT_EQ(server_.on_demand(d), Result::kMalformed) << "runs that touch";
  d = demand(1, {});
  d.digest ^= 1;
  EXPECT_EQ(server_.on_demand(d), Result::kNotServed);
  d = demand(1, {});
  d.origin.session = 2;
  EXPECT_EQ(server_.on_demand(d), Result::kNotServed);
  EXPECT_FALSE(server_.next(0));
}

}  // namespace
}  // namespace tactus::session
