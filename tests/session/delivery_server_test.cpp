#include "session/delivery_server.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "session/delivery_client.hpp"
#include "spm/codec/model_codec.hpp"
#include "spm/codec/page_codec.hpp"
#include "spm/codec/region_codec.hpp"
#include "tests/support/constants.hpp"
#include "tests/support/damaged_model.hpp"
#include "tests/support/random_model.hpp"

namespace tactus::session {
namespace {

using spm::OwnedModel;
using test_support::random_model;

constexpr Origin kSender{kSession, kHost, 5, 0};

class DeliveryServerTest : public testing::Test {
 protected:
  DeliveryServerTest() : owned_{random_model(1, 2000, 3)}, model_{owned_.model()}, server_{kSender} {
    server_.add(kObject, encoded_.compressed());
  }

  Demand make_demand(std::uint32_t epoch, std::vector<std::uint32_t> wanted, std::uint64_t hrtc = kHrtc) {
    Demand result;
    result.origin = {kSession, hrtc, 7, ++time_};
    result.object_id = kObject;
    result.digest = model_.summary.digest;
    result.serving_host = kHost;
    result.epoch = epoch;
    for (const std::uint32_t region : wanted)
      result.wanted.push_back({region, static_cast<std::uint32_t>(result.wanted.size())});
    result.stream = stream_id(kSender, result.origin, kObject);
    result.credit = 1u << 20;
    return result;
  }

  DeliveryServer::DemandResult submit(const Demand& submitted) {
    newest_demand_[submitted.origin.participant] = submitted;
    return server_.on_demand(submitted, now_);
  }
  /// Returns the next chunk. If the pacer delays it by less than 1 ms, advances the time to the end of the delay.
  std::optional<Outgoing> next() {
    std::optional<Outgoing> out = server_.next(now_);
    if (!out && server_.due_ns() - now_ < kMs) out = server_.next(now_ = server_.due_ns());
    if (out) newest_sequence_[out->hrtc] = out->chunk.sequence;
    return out;
  }
  /// Returns the chunks that the server sends without an acknowledgement.
  std::vector<BulkChunk> drain_window(std::size_t limit = 100'000) {
    std::vector<BulkChunk> chunks;
    while (chunks.size() < limit) {
      std::optional<Outgoing> out = next();
      if (!out) break;
      chunks.push_back(std::move(out->chunk));
    }
    return chunks;
  }
  /// Returns the chunks that the server sends while HRTCs acknowledge each of them.
  std::vector<BulkChunk> drain(std::size_t limit = 100'000) {
    std::vector<BulkChunk> chunks;
    for (std::size_t before = 1; chunks.size() != before && chunks.size() < limit;) {
      before = chunks.size();
      for (BulkChunk& chunk : drain_window(limit - before)) chunks.push_back(std::move(chunk));
      now_ += kMs;
      for (const auto& [hrtc, sequence] : newest_sequence_) {
        Demand acknowledgement = newest_demand_.at(hrtc);
        acknowledgement.origin.time_ns = ++time_;
        acknowledgement.newest = sequence;
        server_.on_demand(acknowledgement, now_);
      }
    }
    return chunks;
  }

  static std::vector<BulkPiece> pieces_in(const std::vector<BulkChunk>& chunks) {
    std::vector<BulkPiece> pieces;
    for (const BulkChunk& chunk : chunks) pieces.insert(pieces.end(), chunk.pieces.begin(), chunk.pieces.end());
    return pieces;
  }

  template <class Intervals>
  static std::set<std::uint32_t> records_of(const Intervals& intervals) {
    std::set<std::uint32_t> records;
    for (const spm::Interval& interval : intervals)
      for (std::uint32_t record = interval.first; record != interval.first + interval.count; ++record)
        records.insert(record);
    return records;
  }

  /// Returns the regions in the order in which their last chunks were sent, each with the records sent.
  std::vector<std::pair<std::uint32_t, std::set<std::uint32_t>>> regions_in(const std::vector<BulkChunk>& chunks) {
    std::vector<std::pair<std::uint32_t, std::set<std::uint32_t>>> regions;
    std::vector<std::uint8_t> bytes;
    for (const BulkPiece& piece : pieces_in(chunks)) {
      if (piece.region == spm::kNone) continue;
      if (piece.index == 0) bytes.clear();
      bytes.insert(bytes.end(), piece.payload.begin(), piece.payload.end());
      if (piece.index + 1 != piece.count) continue;
      const auto data = spm::codec::decode_region(bytes, model_.summary, encoded_.compressed().tables());
      if (!data) {
        ADD_FAILURE() << data.error().text;
        continue;
      }
      regions.emplace_back(piece.region, records_of(data->sent));
    }
    return regions;
  }

  std::set<std::uint32_t> closed_list_of(std::uint32_t region) const {
    return records_of(model_.intervals_of(spm::RegionId{region}));
  }

  OwnedModel owned_;
  spm::Model model_;
  spm::codec::EncodedModel encoded_{model_};
  DeliveryServer server_;
  std::int64_t time_ = 0, now_ = 1'000 * kMs;
  std::map<std::uint64_t, Demand> newest_demand_;           // by HRTC
  std::map<std::uint64_t, std::uint32_t> newest_sequence_;  // by HRTC
};

TEST_F(DeliveryServerTest, SendsTheSoonestRegionFirstAndEveryRecordOnce) {
  submit(make_demand(1, {4, 2, 7}));

  const auto regions = regions_in(drain());

  ASSERT_EQ(regions.size(), 3u);
  std::set<std::uint32_t> sent_records;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::uint32_t expected = std::vector<std::uint32_t>{4, 2, 7}[i];
    EXPECT_EQ(regions[i].first, expected);
    std::set<std::uint32_t> missing;
    for (const std::uint32_t record : closed_list_of(expected)) {
      if (sent_records.insert(record).second) missing.insert(record);
    }
    EXPECT_EQ(regions[i].second, missing);
  }
}

TEST(DeliveryServer, SendsNoDamagedRegionAndReportsTheDamageOnce) {
  const test_support::DamagedModel model{test_support::organ_of_several_blocks().compressed()};
  const spm::ModelSummary& summary = model.compressed().summary();
  std::set<std::uint32_t> damaged, sound;
  for (std::uint32_t region = 0; region < summary.regions; ++region)
    (model.is_damaged(region) ? damaged : sound).insert(region);
  ASSERT_GT(damaged.size(), 1u);
  ASSERT_GT(sound.size(), 1u);
  DeliveryServer server{kSender};
  server.add(kObject, model.compressed());
  DeliveryClient client{{kSession, kHrtc, 7, 0}, {}};
  CatalogueEntry entry;
  entry.origin = kSender;
  entry.object_id = kObject;
  entry.summary = summary;
  client.on_catalogue(entry);
  client.open(kObject, summary.digest);
  std::vector<Wanted> wanted;
  for (std::uint32_t region = 0; region < std::min(summary.regions, 400u); ++region) wanted.push_back({region, region});

  std::set<std::uint32_t> received;
  std::vector<DeliveryServer::Damage> reported;
  for (std::int64_t now = 1'000 * kMs; now < 6'000 * kMs; now += kMs) {
    client.on_host_heartbeat(kHost, kSender.incarnation, now);
    while (const auto demand = client.demand(now)) server.on_demand(*demand, now);
    while (const auto out = server.next(now))
      for (const DeliveryClient::Message& message : client.on_chunk(out->chunk, now)) {
        if (message.kind == BulkKind::kBase) {
          client.answer_base_stored(kObject);
          client.set_wanted(kObject, wanted);
        } else {
          client.answer_stored(kObject, message.region);
          received.insert(message.region);
        }
      }
    for (DeliveryServer::Damage& damage : server.take_damage()) reported.push_back(std::move(damage));
  }

  for (const Wanted& each : wanted) EXPECT_EQ(received.count(each.region), sound.count(each.region)) << each.region;
  ASSERT_EQ(reported.size(), 1u);
  EXPECT_EQ(reported.front().object_id, kObject);
  EXPECT_THAT(reported.front().text, testing::HasSubstr("section codes: the checksum of bytes 65536 to 131071"));
}

TEST_F(DeliveryServerTest, FillsEveryChunkButTheLast) {
  submit(make_demand(1, {4, 2, 7, 1, 5}));

  const std::vector<BulkChunk> chunks = drain();

  ASSERT_GT(chunks.size(), 5u);
  std::set<std::uint32_t> shared_chunks;
  for (const BulkChunk& chunk : chunks) {
    std::size_t bytes = 0;
    for (const BulkPiece& piece : chunk.pieces) bytes += header_bytes(piece.region, piece.count) + piece.payload.size();
    EXPECT_LE(bytes, kMaxPayload);
    if (&chunk != &chunks.back()) {
      EXPECT_GT(bytes, kMaxPayload - 64) << "chunk " << chunk.sequence;
    }
    if (chunk.pieces.size() > 1) shared_chunks.insert(chunk.sequence);
  }
  EXPECT_GE(shared_chunks.size(), 3u) << "chunks with the end of one message and the beginning of the next";
}

TEST_F(DeliveryServerTest, ChunksAreAsSmallAsTheirMessagesNeed) {
  constexpr std::size_t kChunkBytes = kMaxPayload - 120;
  DeliveryServer server{kSender, kChunkBytes};
  server.add(kObject, encoded_.compressed());
  ASSERT_EQ(server.on_demand(make_demand(1, {4, 2, 7, 1, 5}), 0), DeliveryServer::DemandResult::kApplied);
  std::size_t full = 0;
  for (std::int64_t now_ns = 0; now_ns < 1'000'000'000; now_ns += 1'000'000) {
    while (const auto sent = server.next(now_ns)) {
      std::size_t bytes = 0;
      for (const BulkPiece& piece : sent->chunk.pieces)
        bytes += header_bytes(piece.region, piece.count) + piece.payload.size();
      ASSERT_LE(bytes, kChunkBytes);
      if (bytes > kChunkBytes - 64) ++full;
    }
  }
  EXPECT_GT(full, 3u);
}

TEST_F(DeliveryServerTest, OmitsTheRecordsOfRegionsInTheDemand) {
  Demand demand = make_demand(1, {3});
  demand.have = {{0, 2}};
  submit(demand);

  const auto regions = regions_in(drain());

  ASSERT_EQ(regions.size(), 1u);
  const std::set<std::uint32_t> first = closed_list_of(0), second = closed_list_of(1);
  for (const std::uint32_t record : closed_list_of(3)) {
    const bool is_present = first.count(record) + second.count(record) != 0;
    EXPECT_EQ(regions[0].second.count(record), is_present ? 0u : 1u) << "record " << record;
  }
}

TEST_F(DeliveryServerTest, SendsARefusedRegionAgain) {
  submit(make_demand(1, {3}));
  const std::vector<BulkChunk> sent = drain();
  Demand demand = make_demand(1, {3});
  demand.received = sent.back().sequence - 1;
  demand.newest = sent.back().sequence;
  submit(demand);
  EXPECT_THAT(drain(), testing::IsEmpty()) << "`received` is still below the last chunk of the region";

  demand = make_demand(1, {3});
  demand.received = sent.back().sequence;
  submit(demand);

  EXPECT_EQ(regions_in(drain()).size(), 1u);
}

TEST_F(DeliveryServerTest, SendsRecordsOfUnansweredRegionsAgainAfterARefusal) {
  submit(make_demand(1, {0, 1, 2}));
  Demand refusal = make_demand(2, {0, 1, 2, 3});
  for (const BulkChunk& chunk : drain()) {
    refusal.newest = chunk.sequence;
    // Region 0 is refused. Regions 1 and 2, which may rely on it, are not answered yet.
    for (const BulkPiece& piece : chunk.pieces)
      if (piece.region == 0) refusal.received = chunk.sequence;
  }

  submit(refusal);
  const auto regions = regions_in(drain());

  ASSERT_EQ(regions.size(), 2u);
  EXPECT_EQ(regions[0].first, 0u);
  EXPECT_EQ(regions[0].second, closed_list_of(0)) << "all records of region 0, although regions 1 and 2 share some";
  EXPECT_EQ(regions[1].first, 3u);
  std::set<std::uint32_t> missing;
  for (const std::uint32_t record : closed_list_of(3))
    if (closed_list_of(0).count(record) == 0) missing.insert(record);
  EXPECT_EQ(regions[1].second, missing);
}

TEST_F(DeliveryServerTest, SendsNoLostPiecesOfACancelledRegion) {
  submit(make_demand(1, {0, 3}));
  Demand lost = make_demand(2, {});
  for (const BulkChunk& chunk : drain_window()) {
    lost.newest = chunk.sequence;
    for (const BulkPiece& piece : chunk.pieces)
      if (piece.region == 0) lost.gaps = {{1, chunk.sequence}};
  }
  ASSERT_FALSE(lost.gaps.empty());

  submit(lost);
  EXPECT_THAT(regions_in(drain()), testing::IsEmpty());
  Demand again = make_demand(3, {0});
  again.newest = lost.newest;
  submit(again);

  const auto regions = regions_in(drain());
  ASSERT_EQ(regions.size(), 1u);
  EXPECT_EQ(regions[0].second, closed_list_of(0)) << "all records of region 0, because none arrived";
}

TEST_F(DeliveryServerTest, IgnoresAcknowledgementsOfAnotherStream) {
  submit(make_demand(1, {3}));
  const std::vector<BulkChunk> sent = drain_window();

  Demand demand = make_demand(2, {3});
  demand.received = demand.newest = sent.back().sequence;
  demand.stream = stream_id({kSession, kHost, 4, 0}, demand.origin, kObject);
  submit(demand);

  EXPECT_THAT(regions_in(drain_window()), testing::IsEmpty());
}

TEST_F(DeliveryServerTest, SendsALostPieceAgainUnchangedUnderANewSequence) {
  submit(make_demand(1, {3}));
  const std::vector<BulkChunk> sent = drain_window(3);
  ASSERT_EQ(pieces_in(sent).size(), sent.size());
  ASSERT_GT(sent.back().pieces[0].count, sent.size());

  Demand demand = make_demand(2, {3});
  demand.received = sent[0].sequence;
  demand.newest = sent.back().sequence;
  demand.gaps = {{sent[1].sequence, 1}};
  submit(demand);
  const std::vector<BulkChunk> again = drain_window(1);

  ASSERT_EQ(again.size(), 1u);
  const BulkPiece &lost = sent[1].pieces[0], &repeated = again[0].pieces.at(0);
  EXPECT_EQ(repeated.region, lost.region);
  EXPECT_EQ(repeated.index, lost.index);
  EXPECT_EQ(repeated.payload, lost.payload);
  EXPECT_EQ(repeated.checksum, lost.checksum);
  EXPECT_GT(again[0].sequence, sent.back().sequence);
  EXPECT_EQ(again[0].epoch, 2u);
  EXPECT_EQ(server_.counters().repeated, 1u);
  demand.origin.time_ns = ++time_;
  submit(demand);
  EXPECT_EQ(drain_window(1).at(0).pieces.at(0).index, sent.back().pieces[0].index + 1)
      << "the lost piece was sent again only once";
}

TEST_F(DeliveryServerTest, ALostPieceOfARegionWhoseBytesHaveChangedIsNotSentAgain) {
  spm::codec::ModelSpans spans = encoded_.compressed().spans();
  spm::codec::Bytes codes{spans.codes.begin(), spans.codes.end()};  // as a file that another program overwrites
  spans.codes = codes;
  server_.add(kObject, *spm::codec::CompressedModel::open(spans));
  Demand demand = make_demand(1, {3});
  demand.have = {{0, 2}};
  submit(demand);
  const std::vector<BulkChunk> sent = drain_window();
  const BulkPiece last = pieces_in(sent).back();
  ASSERT_EQ(last.index + 1, last.count);
  ASSERT_GT(sent.size(), 1u);
  std::fill(codes.begin(), codes.end(), std::uint8_t{0});

  demand = make_demand(2, {3});
  demand.have = {{0, 2}};
  demand.newest = sent.back().sequence;
  demand.gaps = {{sent[0].sequence, 1}};
  submit(demand);

  EXPECT_THAT(pieces_in(drain()), testing::IsEmpty());
  EXPECT_EQ(server_.counters().messages_dropped, 1u);
  const std::vector<DeliveryServer::Damage> damage = server_.take_damage();
  ASSERT_EQ(damage.size(), 1u);
  EXPECT_THAT(damage.front().text, testing::HasSubstr("have changed"));
}

TEST_F(DeliveryServerTest, ALostPieceThatReliesOnARetiredRegionIsNotSentAgain) {
  Demand demand = make_demand(1, {3});
  demand.have = {{0, 2}};
  submit(demand);
  const std::vector<BulkChunk> sent = drain_window();
  ASSERT_GT(sent.size(), 1u);

  demand = make_demand(2, {3});
  demand.newest = sent.back().sequence;
  demand.gaps = {{sent[0].sequence, 1}};
  submit(demand);

  const auto regions = regions_in(drain());
  ASSERT_EQ(regions.size(), 1u);
  EXPECT_EQ(regions[0].second, closed_list_of(3));
}

TEST_F(DeliveryServerTest, SendsAnEchoAfterTheLastChunkSoThatItsLossIsDetected) {
  submit(make_demand(1, {3}));
  const std::vector<BulkChunk> sent = drain_window();
  ASSERT_FALSE(server_.next(now_));

  now_ = server_.due_ns();
  const std::optional<Outgoing> echo = server_.next(now_);

  ASSERT_TRUE(echo);
  EXPECT_EQ(echo->chunk.kind(), BulkKind::kEcho);
  EXPECT_EQ(echo->chunk.sequence, sent.back().sequence + 1);
  EXPECT_FALSE(server_.next(now_)) << "a second echo is not due yet";
  EXPECT_GT(server_.due_ns(), now_);
}

TEST_F(DeliveryServerTest, ACancelledRegionIsNotCompleted) {
  submit(make_demand(1, {3, 5}));
  const std::vector<BulkChunk> begun = drain(1);
  ASSERT_GT(begun[0].pieces.at(0).count, 1u);

  submit(make_demand(2, {5}));

  const std::vector<BulkChunk> chunks = drain();
  const auto regions = regions_in(chunks);
  ASSERT_EQ(regions.size(), 1u);
  EXPECT_EQ(regions[0].first, 5u);
  EXPECT_EQ(regions[0].second, closed_list_of(5)) << "region 5 must not rely on region 3, which was not completed";
  EXPECT_EQ(server_.counters().messages_dropped, 1u);
}

TEST_F(DeliveryServerTest, AMessageThatReliesOnARetiredRegionIsSentAgainWithoutIt) {
  Demand demand = make_demand(1, {3});
  demand.have = {{0, 2}};
  submit(demand);
  const std::vector<BulkChunk> begun = drain(1);
  ASSERT_GT(begun[0].pieces.at(0).count, 1u);

  submit(make_demand(2, {3}));

  const std::vector<BulkChunk> chunks = drain();
  const auto regions = regions_in(chunks);
  ASSERT_EQ(regions.size(), 1u);
  EXPECT_EQ(regions[0].second, closed_list_of(3));
  for (const BulkChunk& chunk : chunks) EXPECT_EQ(chunk.epoch, 2u);
}

TEST_F(DeliveryServerTest, StaysWithinTheCredit) {
  Demand demand = make_demand(1, {0, 1, 2, 3, 4, 5});
  demand.credit = 3 * kMaxPayload;
  submit(demand);

  const std::vector<BulkChunk> first = drain_window();

  EXPECT_GE(first.size(), 3u);
  EXPECT_LE(server_.bytes_in_flight(kHrtc), demand.credit);
  demand.origin.time_ns = ++time_;
  demand.received = demand.newest = first[0].sequence;
  submit(demand);
  EXPECT_GE(drain_window().size(), 1u);
  EXPECT_LE(server_.bytes_in_flight(kHrtc), demand.credit);
}

TEST_F(DeliveryServerTest, AnUnansweredMessageCountsAsInFlight) {
  submit(make_demand(1, {3}));
  std::size_t bytes = 0;
  // All chunks arrive, but `received` stays 0.
  for (const BulkChunk& chunk : drain()) bytes += chunk.payload_bytes();

  EXPECT_EQ(server_.bytes_in_flight(kHrtc), bytes);
}

TEST_F(DeliveryServerTest, EchoesAnEpochWithoutWantedRegionsOnce) {
  submit(make_demand(4, {}));

  const std::vector<BulkChunk> chunks = drain();

  ASSERT_EQ(chunks.size(), 1u);
  EXPECT_EQ(chunks[0].kind(), BulkKind::kEcho);
  EXPECT_EQ(chunks[0].epoch, 4u);
  submit(make_demand(4, {}));
  EXPECT_THAT(drain(), testing::IsEmpty()) << "a keep-alive needs no echo";
}

TEST_F(DeliveryServerTest, EchoesANewEpochWithoutCredit) {
  Demand demand = make_demand(1, {0, 1, 2});
  demand.credit = kMaxPayload;
  submit(demand);
  drain();
  demand = make_demand(2, {0, 1, 2});
  demand.credit = kMaxPayload;
  submit(demand);

  const std::vector<BulkChunk> chunks = drain();

  ASSERT_EQ(chunks.size(), 1u);
  EXPECT_EQ(chunks[0].kind(), BulkKind::kEcho);
  EXPECT_EQ(chunks[0].epoch, 2u);
}

TEST_F(DeliveryServerTest, SendsTheBaseMeshFirstAndAgainWhenItWasRefused) {
  Demand demand = make_demand(1, {3});
  demand.need_base = true;
  submit(demand);
  const std::vector<BulkChunk> base = drain();
  ASSERT_FALSE(base.empty());
  std::size_t bytes = 0;
  for (const BulkChunk& chunk : base) {
    EXPECT_EQ(chunk.kind(), BulkKind::kBase);
    bytes += chunk.payload_bytes();
  }
  EXPECT_EQ(bytes, server_.base_bytes(kObject));

  demand = make_demand(1, {3});
  demand.need_base = true;
  demand.received = demand.newest = base.back().sequence;
  submit(demand);
  EXPECT_EQ(drain().size(), base.size());

  submit(make_demand(2, {3}));
  EXPECT_EQ(regions_in(drain()).size(), 1u);
}

/// The number of the page that contains a region.
std::uint32_t page_with(const spm::Model& model, std::uint32_t region) {
  return number_of(spm::page_of(model.regions[region]));
}

TEST_F(DeliveryServerTest, SendsWantedPagesAfterTheBaseMeshAndRegionsWhenTheHrtcHasIt) {
  const std::uint32_t page = page_with(model_, 3);
  Demand demand = make_demand(1, {3, page});
  demand.need_base = true;
  submit(demand);
  const std::vector<BulkChunk> sent = drain();
  ASSERT_GE(sent.size(), 2u);
  for (std::size_t i = 0; i + 1 < sent.size(); ++i) EXPECT_EQ(sent[i].kind(), BulkKind::kBase);
  const std::vector<BulkPiece> pieces = pieces_in({sent.back()});
  ASSERT_EQ(pieces.size(), 1u) << "no region before the base mesh has come";
  EXPECT_EQ(pieces[0].region, page);
  const auto decoded = spm::codec::decode_page(pieces[0].payload, model_.summary);
  ASSERT_TRUE(decoded) << decoded.error().text;
  EXPECT_EQ(number_of(decoded->id), page);
  EXPECT_EQ(server_.counters().pages, 1u);

  submit(make_demand(2, {3}));
  EXPECT_EQ(regions_in(drain()).size(), 1u);
}

TEST_F(DeliveryServerTest, APageIsSentAgainIfItIsLostOrStillWantedAfterItWasProcessed) {
  const std::uint32_t page = page_with(model_, 0);
  submit(make_demand(1, {page}));
  std::vector<BulkChunk> sent = drain_window();
  ASSERT_EQ(pieces_in(sent).size(), 1u);
  Demand lost = make_demand(2, {page});
  lost.newest = sent[0].sequence;
  lost.gaps = {{sent[0].sequence, 1}};
  submit(lost);
  sent = drain_window();
  ASSERT_EQ(pieces_in(sent).size(), 1u) << "repeated";
  Demand refused = make_demand(3, {page});
  refused.received = refused.newest = sent.back().sequence;
  submit(refused);
  sent = drain_window();
  ASSERT_EQ(pieces_in(sent).size(), 1u) << "planned anew";
  Demand stored = make_demand(4, {});
  stored.received = stored.newest = sent.back().sequence;
  submit(stored);
  EXPECT_TRUE(pieces_in(drain_window()).empty());
}

TEST_F(DeliveryServerTest, SendsAllPagesInOneMessage) {
  submit(make_demand(1, {kAllPages}));
  std::vector<std::uint8_t> bytes;
  for (const BulkPiece& piece : pieces_in(drain())) {
    EXPECT_EQ(piece.region, kAllPages);
    bytes.insert(bytes.end(), piece.payload.begin(), piece.payload.end());
  }
  const auto pages = spm::codec::decode_pages(bytes, model_.summary);
  ASSERT_TRUE(pages) << pages.error().text;
  std::size_t regions = 0;
  for (const spm::Page& page : *pages) regions += page.regions.size();
  EXPECT_EQ(regions, model_.summary.regions);
}

TEST_F(DeliveryServerTest, ANumberThatIsNeitherARegionNorAPageIsMalformed) {
  for (const std::uint32_t number : {model_.summary.regions, kFirstPage - 1, kFirstPage + spm::kPageIds, 0xffffffffu})
    EXPECT_EQ(submit(make_demand(1, {number})), DeliveryServer::DemandResult::kMalformed) << number;
}

TEST_F(DeliveryServerTest, SendsNothingWhileAnotherHostServes) {
  submit(make_demand(1, {3}));
  drain(1);
  Demand demand = make_demand(2, {3});
  demand.serving_host = 11;
  submit(demand);
  EXPECT_THAT(drain(), testing::IsEmpty());

  submit(make_demand(1, {3}));
  EXPECT_THAT(drain(), testing::IsEmpty()) << "a demand of an earlier epoch has no effect";

  submit(make_demand(3, {3}));
  EXPECT_EQ(regions_in(drain()).at(0).second, closed_list_of(3));
}

TEST_F(DeliveryServerTest, AlternatesBetweenHrtcsChunkByChunk) {
  submit(make_demand(1, {0, 1, 2, 3}));
  submit(make_demand(1, {3, 2, 1, 0}, kOtherHrtc));

  std::uint64_t before = 0;
  for (int i = 0; i < 10; ++i) {
    now_ += kMs;  // the pacer of each HRTC allows a chunk
    const std::optional<Outgoing> out = server_.next(now_);
    ASSERT_TRUE(out);
    EXPECT_NE(out->hrtc, before) << "chunk " << i;
    before = out->hrtc;
  }
}

TEST_F(DeliveryServerTest, ABlockedHrtcDoesNotDelayOthers) {
  submit(make_demand(1, {0}));
  submit(make_demand(1, {0}, kOtherHrtc));

  const auto except_first = [](std::uint64_t hrtc) { return hrtc != kHrtc; };
  const std::optional<Outgoing> first = server_.next(now_, except_first);
  const std::optional<Outgoing> second = server_.next(now_ + kMs, except_first);

  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->hrtc, kOtherHrtc);
  EXPECT_EQ(second->hrtc, kOtherHrtc);
  EXPECT_FALSE(server_.next(now_, [](std::uint64_t) { return false; }));
}

TEST_F(DeliveryServerTest, ANewIncarnationOfAnHrtcReceivesANewStream) {
  submit(make_demand(9, {3}));
  const std::vector<BulkChunk> before = drain();
  Demand demand = make_demand(1, {3});
  demand.origin.incarnation = 8;
  demand.stream = stream_id(kSender, demand.origin, kObject);
  newest_sequence_.clear();
  submit(demand);

  const std::vector<BulkChunk> after = drain();

  EXPECT_EQ(regions_in(after).at(0).second, closed_list_of(3));
  EXPECT_NE(after.front().stream, before.back().stream);
  EXPECT_EQ(submit(make_demand(10, {3})), DeliveryServer::DemandResult::kImplausible) << "from the old incarnation";
}

TEST_F(DeliveryServerTest, AnHrtcThatReturnsReceivesLargerSequences) {
  submit(make_demand(1, {3}));
  const std::vector<BulkChunk> before = drain();
  server_.on_hrtc_gone(kHrtc);
  EXPECT_FALSE(server_.next(now_));

  submit(make_demand(1, {3}));

  const std::vector<BulkChunk> after = drain();
  ASSERT_FALSE(after.empty());
  EXPECT_GT(after.front().sequence, before.back().sequence);
}

TEST_F(DeliveryServerTest, AFreshStreamBeginsAtOneAfterAnHrtcWasDropped) {
  submit(make_demand(1, {3}));
  const std::vector<BulkChunk> before = drain();
  ASSERT_FALSE(before.empty());
  server_.on_hrtc_gone(kHrtc);
  newest_sequence_.clear();

  submit(make_demand(1, {3}, kOtherHrtc));
  const std::vector<BulkChunk> other = drain();
  ASSERT_FALSE(other.empty());
  EXPECT_EQ(other.front().sequence, 1u) << "the client would report all smaller numbers as lost";

  newest_sequence_.clear();
  Demand restarted = make_demand(1, {3});
  ++restarted.origin.incarnation;
  restarted.stream = stream_id(kSender, restarted.origin, kObject);
  submit(restarted);
  const std::vector<BulkChunk> after = drain();
  ASSERT_FALSE(after.empty());
  EXPECT_EQ(after.front().sequence, 1u) << "a new incarnation has a new stream";
}

TEST_F(DeliveryServerTest, AStreamContinuesAfterManyOtherHrtcsWereDropped) {
  submit(make_demand(1, {3}));
  const std::vector<BulkChunk> before = drain();
  ASSERT_FALSE(before.empty());
  server_.on_hrtc_gone(kHrtc);
  newest_sequence_.clear();
  for (std::uint64_t hrtc = 1000; hrtc < 6000; ++hrtc) {
    submit(make_demand(1, {}, hrtc));
    (void)server_.next(now_);
    server_.on_hrtc_gone(hrtc);
  }

  Demand returned = make_demand(1, {3});
  returned.received = returned.newest = before.back().sequence;
  submit(returned);

  const std::vector<BulkChunk> after = drain();
  ASSERT_FALSE(after.empty());
  EXPECT_EQ(after.front().sequence, before.back().sequence + 1);
}

TEST_F(DeliveryServerTest, RefusesMalformedAndForeignDemands) {
  using Result = DeliveryServer::DemandResult;
  const std::uint32_t regions = model_.summary.regions;
  Demand demand = make_demand(1, {regions});
  EXPECT_EQ(submit(demand), Result::kMalformed);
  demand = make_demand(1, {});
  demand.have = {{5, 0xffffffffu}};
  EXPECT_EQ(submit(demand), Result::kMalformed);
  demand.have = {{5, 1}, {4, 1}};
  EXPECT_EQ(submit(demand), Result::kMalformed);
  demand.have = {{4, 1}, {5, 1}};
  EXPECT_EQ(submit(demand), Result::kMalformed) << "adjacent intervals must be one interval";
  demand = make_demand(1, {});
  demand.digest ^= 1;
  EXPECT_EQ(submit(demand), Result::kNotServed);
  demand = make_demand(1, {});
  demand.origin.session = 2;
  EXPECT_EQ(submit(demand), Result::kNotServed);
  EXPECT_FALSE(server_.next(now_));
}

TEST_F(DeliveryServerTest, AppliesDemandsAfterOneImplausibleDemand) {
  using Vary = void (*)(Demand&);
  for (const Vary vary : {Vary{[](Demand& demand) { demand.epoch = 0xffffffff; }},
                          Vary{[](Demand& demand) { demand.origin.time_ns = INT64_MAX; }},
                          Vary{[](Demand& demand) { demand.origin.incarnation = UINT64_MAX; }}}) {
    DeliveryServer server{kSender};
    server.add(kObject, encoded_.compressed());
    const auto submit_later = [&](const Demand& submitted) { return server.on_demand(submitted, now_ += 5 * kMs); };
    const auto with_time = [&](Demand submitted) {
      submitted.origin.time_ns = now_ + 5 * kMs;
      return submitted;
    };
    std::uint32_t epoch = 0;
    for (int i = 0; i < 20; ++i)
      ASSERT_EQ(submit_later(with_time(make_demand(++epoch, {1}))), DeliveryServer::DemandResult::kApplied);
    Demand wrong = with_time(make_demand(++epoch, {1}));
    vary(wrong);
    (void)submit_later(wrong);
    for (int i = 0; i < 4; ++i) (void)submit_later(with_time(make_demand(++epoch, {1})));
    Demand without_credit = with_time(make_demand(++epoch, {2}));
    without_credit.credit = 0;
    EXPECT_EQ(submit_later(without_credit), DeliveryServer::DemandResult::kApplied);
    for (int i = 0; i < 10; ++i) {
      const std::optional<Outgoing> out = server.next(now_ + 100 * kMs);
      EXPECT_TRUE(!out || out->chunk.kind() == BulkKind::kEcho) << "the credit of the last demand applies";
    }
  }
}

TEST_F(DeliveryServerTest, AFloodOfDemandsCostsOneComparisonPerPass) {
  constexpr std::uint64_t kPasses = 10;
  const std::vector<spm::Interval> one{{0, 1}}, all{{0, model_.summary.regions}};
  for (std::uint64_t pass = 0; pass < kPasses; ++pass, now_ += kMs) {
    for (int i = 0; i < 1000; ++i) {
      Demand demand = make_demand(1, {});
      demand.have = i % 2 == 0 ? all : one;
      ASSERT_EQ(submit(demand), DeliveryServer::DemandResult::kApplied);
    }
    EXPECT_EQ(server_.counters().comparisons, pass);
    (void)drain_window();
    EXPECT_EQ(server_.counters().comparisons, pass + 1);
  }

  Demand newest = make_demand(2, {3});
  newest.have = one;
  submit(newest);
  const auto regions = regions_in(drain_window());
  ASSERT_EQ(regions.size(), 1u);
  EXPECT_EQ(regions[0].first, 3u);
  for (const std::uint32_t record : closed_list_of(3))
    EXPECT_EQ(regions[0].second.count(record), 1 - closed_list_of(0).count(record)) << "record " << record;
}

TEST_F(DeliveryServerTest, ADemandThatWasNotComparedDoesNotHideARetiredRegion) {
  Demand demand = make_demand(1, {});
  demand.have = {{0, 2}};
  submit(demand);
  (void)drain();
  submit(make_demand(2, {}));  // has no region, so the next demand only adds regions to it
  demand = make_demand(2, {3});
  demand.have = {{1, 1}};
  submit(demand);

  const auto regions = regions_in(drain_window());

  ASSERT_EQ(regions.size(), 1u);
  for (const std::uint32_t record : closed_list_of(3))
    EXPECT_EQ(regions[0].second.count(record), 1 - closed_list_of(1).count(record)) << "record " << record;
}

TEST_F(DeliveryServerTest, AStopBetweenTwoPassesIsApplied) {
  submit(make_demand(1, {3}));
  const std::vector<BulkChunk> begun = drain_window(1);
  ASSERT_GT(begun.at(0).pieces.at(0).count, 1u);
  Demand stop = make_demand(2, {3});
  stop.serving_host = kOtherHost;
  submit(stop);
  submit(make_demand(3, {3}));

  const std::vector<BulkChunk> chunks = drain();

  ASSERT_FALSE(chunks.empty());
  EXPECT_EQ(chunks.front().sequence, begun.back().sequence + 1);
  EXPECT_EQ(chunks.front().epoch, 3u);
  const auto regions = regions_in(chunks);
  ASSERT_EQ(regions.size(), 1u);
  EXPECT_EQ(regions[0].second, closed_list_of(3)) << "the first piece is sent again";
}

TEST_F(DeliveryServerTest, AReportedLossIsAppliedAlthoughANewerDemandFollows) {
  submit(make_demand(1, {3}));
  const std::vector<BulkChunk> sent = drain_window();
  ASSERT_GT(sent.size(), 2u);
  Demand loss = make_demand(2, {3});
  loss.received = sent[0].sequence;
  loss.newest = sent[1].sequence;
  loss.gaps = {{sent[1].sequence, 1}};
  submit(loss);
  Demand newer = loss;
  newer.origin.time_ns = ++time_;
  newer.newest = sent.back().sequence;
  submit(newer);

  const std::vector<BulkPiece> again = pieces_in(drain_window());

  ASSERT_FALSE(again.empty());
  EXPECT_EQ(again[0].index, sent[1].pieces.at(0).index);
  EXPECT_EQ(server_.counters().repeated, 1u);
}

TEST_F(DeliveryServerTest, AnHrtcThatSendsNoDemandsIsDropped) {
  submit(make_demand(1, {}));
  for (std::uint64_t hrtc = 1000; hrtc < 1100; ++hrtc) submit(make_demand(1, {}, hrtc));
  server_.on_hrtc_gone(1000);
  submit(make_demand(2, {}, 1000));  // was in flight when the HRTC left
  EXPECT_EQ(server_.counters_by_hrtc().size(), 101u);
  for (std::uint32_t epoch = 2; epoch < 40; ++epoch, now_ += DeliverySettings{}.keep_alive_ns) {
    submit(make_demand(epoch, {}));
    (void)drain_window();
  }

  EXPECT_EQ(server_.counters_by_hrtc().size(), 1u);
  EXPECT_EQ(server_.counters_by_hrtc().count(kHrtc), 1u) << "this HRTC repeats its demands";
}

TEST(MessagePieces, EveryByteOfALargeMessageIsInOnePiece) {
  constexpr std::uint32_t kBytes = 200'000'000;  // needs more than 65,535 pieces
  const MessagePieces pieces = MessagePieces::cut(kBytes, spm::kNone, kMaxPayload);
  std::size_t end = 0;
  for (std::uint32_t piece = 0; piece < pieces.count; ++piece) {
    const auto [from, to] = pieces.range(piece);
    ASSERT_EQ(from, end);
    ASSERT_LT(from, to);
    ASSERT_LE(to - from + header_bytes(spm::kNone, pieces.count), kMaxPayload);
    end = to;
  }
  EXPECT_EQ(end, kBytes);
}

}  // namespace
}  // namespace tactus::session
