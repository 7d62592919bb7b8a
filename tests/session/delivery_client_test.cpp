#include "session/delivery_client.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <functional>

#include "tests/support/constants.hpp"

namespace tactus::session {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr std::uint64_t kDigest = 99;
constexpr std::uint32_t kRegions = 300'000;
constexpr Origin kReceiver{kSession, kHrtc, 7, 0};

class DeliveryClientTest : public testing::Test {
 protected:
  DeliveryClientTest() : client_{kReceiver, DeliverySettings{}} {
    for (const std::uint64_t host : {kHost, kOtherHost}) client_.on_catalogue(catalogue_entry(host));
    client_.on_host_heartbeat(kHost, 5, now_);
    client_.open(kObject, kDigest);
    deliver_base_mesh();
  }

  static CatalogueEntry catalogue_entry(std::uint64_t host) {
    CatalogueEntry entry;
    entry.origin = {kSession, host, 5, 0};
    entry.object_id = kObject;
    entry.summary.digest = kDigest;
    entry.summary.regions = kRegions;
    return entry;
  }

  void deliver_base_mesh() {
    ASSERT_TRUE(client_.demand(now_)->need_base);
    ASSERT_TRUE(receive(chunks(spm::kNone, "base", 1)));
    client_.answer_base_stored(kObject);
  }

  /// Returns `count` chunks, each with one piece of a message that contains `text`.
  std::vector<BulkChunk> chunks(std::uint32_t region, const std::string& text, std::uint32_t count) {
    std::vector<BulkChunk> result(count);
    const std::vector<std::uint8_t> bytes(text.begin(), text.end());
    const std::size_t size = (text.size() + count - 1) / count;
    for (std::uint32_t i = 0; i < count; ++i) {
      BulkChunk& chunk = result[i];
      chunk.stream = stream_id({kSession, kHost, 5, 0}, kReceiver, kObject);
      chunk.sent_us = static_cast<std::uint32_t>(now_ / 1000);
      chunk.sequence = ++sequence_;
      chunk.epoch = epoch_;
      const std::string piece = text.substr(std::min(text.size(), i * size), size);
      chunk.pieces.push_back({region, i, count, checksum_of(bytes), {piece.begin(), piece.end()}});
    }
    return result;
  }
  /// Returns the first pieces of the messages of the regions below `count`, each with two pieces of one byte. A chunk
  /// has 100 pieces.
  std::vector<BulkChunk> first_pieces(std::uint32_t count) {
    constexpr std::uint32_t kPiecesPerChunk = 100;
    std::vector<BulkChunk> result;
    for (std::uint32_t region = 0; region < count; ++region) {
      if (region % kPiecesPerChunk == 0) result.push_back(echo());
      result.back().pieces.push_back({region, 0, 2, checksum_of(kTwoBytes), {kTwoBytes[0]}});
    }
    return result;
  }
  /// Returns a chunk with the second piece of one of these messages.
  BulkChunk second_piece(std::uint32_t region) {
    BulkChunk chunk = echo();
    chunk.pieces.push_back({region, 1, 2, checksum_of(kTwoBytes), {kTwoBytes[1]}});
    return chunk;
  }
  BulkChunk echo() {
    BulkChunk chunk = chunks(spm::kNone, "", 1).at(0);
    chunk.pieces.clear();
    return chunk;
  }

  /// Returns the demand that is due 10 ms later. The chunks made afterwards have its epoch.
  Demand publish() {
    const std::optional<Demand> demand = client_.demand(now_ += 10 * kMs);
    if (!demand) {
      ADD_FAILURE() << "no demand is due";
      return {};
    }
    epoch_ = demand->epoch;
    return *demand;
  }

  Demand publish_after_change() {
    client_.set_wanted(kObject, {{next_region_++, 0}});
    return publish();
  }

  /// Returns the last message that the chunks complete.
  std::optional<DeliveryClient::Message> receive(const std::vector<BulkChunk>& sent) {
    std::optional<DeliveryClient::Message> message;
    for (const BulkChunk& chunk : sent) {
      for (DeliveryClient::Message& complete : client_.on_chunk(chunk, now_)) message = std::move(complete);
    }
    return message;
  }

  void deliver_and_hold(std::uint32_t region) {
    ASSERT_TRUE(receive(chunks(region, "region " + std::to_string(region), 2)));
    client_.answer_stored(kObject, region);
  }

  /// Runs for `duration_ns` with heartbeats of `hosts`. In each step of 20 ms, the hosts receive the demands.
  void run_with_heartbeats(const std::vector<std::uint64_t>& hosts, std::int64_t duration_ns) {
    for (const std::int64_t end = now_ + duration_ns; now_ < end; now_ += 20 * kMs) {
      for (const std::uint64_t host : hosts) client_.on_host_heartbeat(host, 5, now_);
      while (const std::optional<Demand> demand = client_.demand(now_)) epoch_ = demand->epoch;
    }
  }

  static constexpr std::array<std::uint8_t, 2> kTwoBytes{1, 2};
  std::int64_t now_ = 1'000 * kMs;
  std::uint32_t sequence_ = 0;
  std::uint32_t next_region_ = 100;
  std::uint32_t epoch_ = 1;
  DeliveryClient client_;
};

TEST_F(DeliveryClientTest, MeasuresTheRoundTripFromADemandToTheFirstChunkOfItsEpoch) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  now_ += 40 * kMs;
  receive({echo()});
  const std::int64_t first = client_.round_trip_ns();
  for (std::uint32_t i = 0; i < 100; ++i) {
    client_.set_wanted(kObject, {{5 + i, 0}});
    publish();
    now_ += 8 * kMs;
    receive({echo()});
  }

  EXPECT_NEAR(static_cast<double>(first), 40 * kMs, 10 * kMs) << "smoothed with the round trip of the base mesh";
  EXPECT_NEAR(static_cast<double>(client_.round_trip_ns()), 8 * kMs, kMs);
}

TEST_F(DeliveryClientTest, CreditGrowsWithRateTimesRoundTripUpToTheFreeMemory) {
  const std::uint32_t initial_credit = publish_after_change().credit;
  const std::string text(1100, 'x');
  std::uint32_t credit = 0;
  for (int round = 0; round < 20; ++round) {
    const Demand demand = publish_after_change();
    credit = demand.credit;
    now_ += 90 * kMs;
    // In 100 ms the whole credit arrives, at most 2 MB.
    for (std::uint32_t sent = 0; sent < std::min(credit, 2'000'000u); sent += 1100) receive(chunks(1000, text, 2000));
  }
  client_.limit_credit(70'000);
  const std::uint32_t limited_credit = publish_after_change().credit;

  EXPECT_EQ(initial_credit, DeliverySettings{}.credit);
  EXPECT_GT(credit, 4 * initial_credit);
  EXPECT_LE(credit, DeliverySettings{}.max_credit);
  EXPECT_EQ(limited_credit, 70'000u);
}

TEST_F(DeliveryClientTest, ANewMemoryLimitIsPublishedAtOnceWhileAnAnswerIsDue) {
  client_.limit_credit(0);
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  receive({echo()});
  ASSERT_FALSE(client_.demand(now_ += 4 * kMs)) << "nothing has changed";

  client_.limit_credit(100'000);

  EXPECT_EQ(publish().credit, 100'000u);
}

TEST_F(DeliveryClientTest, AnUrgentRegionIsRequestedAfterAShorterInterval) {
  const DeliverySettings settings;
  client_.set_wanted(kObject, {{4, 2 * settings.urgent_us}});
  publish();
  const std::int64_t published = now_;
  client_.set_wanted(kObject, {{4, 2 * settings.urgent_us}, {5, 2 * settings.urgent_us}});
  EXPECT_FALSE(client_.demand(published + settings.urgent_interval_ns)) << "no contact is expected soon";

  client_.set_wanted(kObject, {{4, 2 * settings.urgent_us}, {6, settings.urgent_us / 2}});
  ASSERT_TRUE(client_.demand(published + settings.urgent_interval_ns));

  client_.set_wanted(kObject, {{6, settings.urgent_us / 4}});
  EXPECT_FALSE(client_.demand(published + 2 * settings.urgent_interval_ns)) << "region 6 has been requested before";
}

TEST_F(DeliveryClientTest, JoinsPiecesInAnyOrderAndReturnsTheMessageOnce) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  std::vector<BulkChunk> sent = chunks(4, "the bytes of the region", 5);
  std::swap(sent[0], sent[3]);
  std::swap(sent[2], sent[4]);
  sent.insert(sent.begin() + 2, sent[1]);

  const auto message = receive(sent);

  ASSERT_TRUE(message);
  EXPECT_EQ(std::string(message->bytes.begin(), message->bytes.end()), "the bytes of the region");
  EXPECT_EQ(message->region, 4u);
  EXPECT_FALSE(receive(sent)) << "the message was returned before and is not answered yet";
  EXPECT_EQ(client_.partial_bytes(), 0u);
}

TEST_F(DeliveryClientTest, AChunkCompletesSeveralMessagesAndBeginsAnother) {
  client_.set_wanted(kObject, {{4, 0}, {5, 0}, {6, 0}});
  publish();
  std::vector<BulkChunk> first = chunks(4, "begins in an earlier chunk", 2);
  const std::vector<BulkChunk> single = chunks(5, "one piece", 1), last = chunks(6, "ends in a later chunk", 2);
  ASSERT_FALSE(receive({first[0]}));
  first[1].pieces.push_back(single[0].pieces[0]);
  first[1].pieces.push_back(last[0].pieces[0]);

  const std::vector<DeliveryClient::Message> messages = client_.on_chunk(first[1], now_);

  ASSERT_EQ(messages.size(), 2u);
  EXPECT_EQ(messages[0].region, 4u);
  EXPECT_EQ(messages[1].region, 5u);
  client_.answer_stored(kObject, 4);
  EXPECT_EQ(publish().received, first[1].sequence - 1) << "region 5 waits for its answer";
  client_.answer_stored(kObject, 5);
  EXPECT_EQ(publish().received, first[1].sequence);
  EXPECT_TRUE(receive({last[1]}));
}

TEST_F(DeliveryClientTest, AcceptsACancelledMessageThatIsSentAgainInOtherPieces) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  const std::string text = "the bytes of region four";
  // `again` has as many pieces and bytes as `cancelled`, but a shorter first piece.
  std::vector<BulkChunk> again = chunks(4, text, 2);
  const std::vector<BulkChunk> cancelled = chunks(4, text, 2);
  std::vector<std::uint8_t>& first = again[0].pieces[0].payload;
  std::vector<std::uint8_t>& second = again[1].pieces[0].payload;
  second.insert(second.begin(), first.end() - 5, first.end());
  first.resize(first.size() - 5);
  for (BulkChunk& chunk : again) chunk.sequence = ++sequence_;

  ASSERT_FALSE(receive({cancelled[0]}));
  const auto message = receive(again);

  ASSERT_TRUE(message);
  EXPECT_EQ(std::string(message->bytes.begin(), message->bytes.end()), text);
  EXPECT_EQ(client_.counters().corrupt, 0u);
}

TEST_F(DeliveryClientTest, DropsAMessageWhoseChecksumIsWrong) {
  std::vector<BulkChunk> sent = chunks(4, "the bytes of the region", 3);
  sent[1].pieces[0].payload[0] ^= 1;

  EXPECT_FALSE(receive(sent));
  EXPECT_EQ(client_.counters().corrupt, 1u);
}

TEST_F(DeliveryClientTest, IgnoresForeignAndMalformedChunks) {
  const auto other_stream = [](std::uint64_t session, std::uint64_t host, std::uint64_t incarnation, std::uint64_t hrtc,
                               std::uint64_t object) {
    return stream_id({session, host, incarnation, 0}, {session, hrtc, 7, 0}, object);
  };
  const auto variations = std::vector<std::function<void(BulkChunk&)>>{
      [&](BulkChunk& chunk) { chunk.stream = other_stream(2, kHost, 5, kHrtc, kObject); },
      [&](BulkChunk& chunk) { chunk.stream = other_stream(kSession, kHost, 5, 21, kObject); },
      [&](BulkChunk& chunk) { chunk.stream = other_stream(kSession, kHost, 5, kHrtc, 31); },
      [&](BulkChunk& chunk) { chunk.stream = other_stream(kSession, kHost, 4, kHrtc, kObject); },
      [&](BulkChunk& chunk) { chunk.stream = other_stream(kSession, 12, 5, kHrtc, kObject); },
      [](BulkChunk& chunk) { chunk.pieces[0].index = 1; },
      [](BulkChunk& chunk) {
        chunk.pieces.push_back({spm::kNone, 0, 1, 0, {1}});
      },
      [](BulkChunk& chunk) { chunk.epoch += 100; },
      [](BulkChunk& chunk) {
        chunk.is_from_member = true;
        chunk.senders = {kHost + 1};
      },
      [](BulkChunk& chunk) { chunk.is_from_member = true; },  // with keys, of a program without an id
      [](BulkChunk& chunk) { chunk.pieces[0].region = kRegions; },
      [](BulkChunk& chunk) { chunk.pieces[0].payload.resize(kMaxPayload + 1); }};
  for (const auto& vary : variations) {
    std::vector<BulkChunk> sent = chunks(4, "x", 1);
    vary(sent[0]);
    EXPECT_FALSE(receive(sent));
  }
  EXPECT_EQ(client_.counters().foreign, variations.size());
}

TEST_F(DeliveryClientTest, AMessageCountsAsReceivedOnlyAfterTheAnswerOfTheCaller) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  const std::vector<BulkChunk> sent = chunks(4, "abc", 3);
  ASSERT_TRUE(receive(sent));
  EXPECT_EQ(publish().received, sent.back().sequence - 1);

  client_.answer_stored(kObject, 4);

  const Demand demand = publish();
  EXPECT_EQ(demand.received, sent.back().sequence);
  ASSERT_EQ(demand.have.size(), 1u);
  EXPECT_THAT(demand.wanted, IsEmpty());
}

TEST_F(DeliveryClientTest, AnOldGapIsReportedUntilTheHostAnswers) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  std::vector<BulkChunk> sent = chunks(4, "abcd", 4);
  const std::uint32_t first = sent[0].sequence;
  sent.erase(sent.begin() + 1);
  EXPECT_FALSE(receive(sent));
  const std::optional<Demand> early = client_.demand(now_ + DeliverySettings{}.urgent_interval_ns);
  EXPECT_FALSE(early) << "the chunk may have been overtaken";

  const Demand demand = publish();

  EXPECT_EQ(demand.received, first);
  EXPECT_EQ(demand.newest, first + 3);
  ASSERT_EQ(demand.gaps.size(), 1u);
  EXPECT_EQ(demand.gaps[0].first, first + 1);
  EXPECT_EQ(demand.gaps[0].count, 1u);
  EXPECT_EQ(client_.counters().lost, 1u);
  EXPECT_EQ(publish_after_change().gaps.size(), 1u) << "the host has not answered";
  (void)client_.on_chunk(echo(), now_);
  const Demand after = publish_after_change();
  EXPECT_EQ(after.received, first + 4);
  EXPECT_TRUE(after.gaps.empty());
}

TEST_F(DeliveryClientTest, AFilledGapIsNotReported) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  std::vector<BulkChunk> sent = chunks(4, "abcde", 5);
  const std::uint32_t last = sent.back().sequence;
  EXPECT_FALSE(receive({sent[4], sent[0]}));
  EXPECT_FALSE(receive({sent[2]}));
  EXPECT_TRUE(receive({sent[3], sent[1]}));
  client_.answer_stored(kObject, 4);

  const Demand demand = publish();
  EXPECT_EQ(demand.received, last);
  EXPECT_TRUE(demand.gaps.empty());
}

TEST_F(DeliveryClientTest, ReportsTheMinOneWayDelaySinceTheLastDemand) {
  publish_after_change();
  std::vector<BulkChunk> sent = chunks(4, "abc", 3);
  const auto sent_us = static_cast<std::uint32_t>(now_ / 1000);
  sent[0].sent_us = sent_us - 700;
  sent[1].sent_us = sent_us + 5;  // the clocks of host and HRTC are independent
  sent[2].sent_us = sent_us - 20;
  receive(sent);

  const Demand demand = publish();
  EXPECT_EQ(demand.arrivals, 3u);
  EXPECT_EQ(static_cast<std::int32_t>(demand.one_way_us), -5);
  EXPECT_EQ(publish_after_change().arrivals, 0u);
}

TEST_F(DeliveryClientTest, ARetiredRegionIsReleasedAfterTheEchoAndAllEarlierChunks) {
  deliver_and_hold(4);
  publish();
  ASSERT_TRUE(client_.retire(kObject, 4));
  EXPECT_THAT(publish().have, IsEmpty());
  EXPECT_THAT(client_.take_released(kObject), IsEmpty());

  epoch_ -= 1;
  const std::vector<BulkChunk> of_earlier_epoch = chunks(5, "relies on region 4", 1);
  epoch_ += 1;
  EXPECT_FALSE(receive({echo()}));
  EXPECT_THAT(client_.take_released(kObject), IsEmpty()) << "a message before the echo is still in flight";

  EXPECT_TRUE(receive(of_earlier_epoch));
  EXPECT_THAT(client_.take_released(kObject), IsEmpty()) << "the message waits for the caller's answer";
  client_.answer_stored(kObject, 5);
  EXPECT_THAT(client_.take_released(kObject), ElementsAre(4u));
  EXPECT_THAT(client_.take_released(kObject), IsEmpty());
}

TEST_F(DeliveryClientTest, AParkedMessageCountsAsInFlightButDelaysNoRelease) {
  deliver_and_hold(4);
  publish();
  client_.set_wanted(kObject, {{5, 0}});
  ASSERT_TRUE(client_.retire(kObject, 4));
  publish();
  epoch_ -= 1;
  const std::vector<BulkChunk> postponed = chunks(5, "relies on region 4", 1);
  epoch_ += 1;
  ASSERT_TRUE(receive(postponed));
  EXPECT_FALSE(receive({echo()}));
  EXPECT_THAT(client_.take_released(kObject), IsEmpty());

  client_.postpone_answer(kObject, 5);

  EXPECT_THAT(client_.take_released(kObject), ElementsAre(4u));
  EXPECT_EQ(publish_after_change().received, postponed.back().sequence - 1);
  client_.answer_refused(kObject, 5);
  EXPECT_GT(publish().received, postponed.back().sequence);
}

TEST_F(DeliveryClientTest, APublishedCreditRemainsGrantedForARoundTrip) {
  client_.limit_credit(200'000);
  publish_after_change();
  client_.limit_credit(50'000);
  publish_after_change();
  EXPECT_EQ(client_.granted_credit(now_), 200'000u);
  EXPECT_EQ(client_.granted_credit(now_ + 1000 * kMs), 50'000u) << "the last credit holds until the next is published";

  client_.limit_credit(80'000);
  publish_after_change();
  EXPECT_EQ(client_.granted_credit(now_), 80'000u);
}

TEST_F(DeliveryClientTest, AMessageOfAnEpochBeforeTheRetirementIsDroppedAfterTheRelease) {
  deliver_and_hold(4);
  publish();
  ASSERT_TRUE(client_.retire(kObject, 4));
  const std::uint32_t old_epoch = epoch_;
  publish();
  (void)client_.on_chunk(echo(), now_);
  ASSERT_THAT(client_.take_released(kObject), ElementsAre(4u));

  epoch_ = old_epoch;

  EXPECT_FALSE(receive(chunks(5, "relies on region 4", 1)));
  EXPECT_EQ(client_.counters().stale, 1u);
}

TEST_F(DeliveryClientTest, AMessageBegunBeforeARetirementIsAcceptedIfTheHostContinuesIt) {
  deliver_and_hold(4);
  publish();
  const std::vector<BulkChunk> begun = chunks(5, "does not rely on region 4", 2);
  (void)client_.on_chunk(begun[0], now_);
  ASSERT_TRUE(client_.retire(kObject, 4));
  publish();
  sequence_ -= 1;
  (void)client_.on_chunk(echo(), now_);
  ASSERT_THAT(client_.take_released(kObject), ElementsAre(4u));

  BulkChunk second = begun[1];
  second.epoch = epoch_;
  second.sequence = ++sequence_;

  EXPECT_TRUE(receive({second}));
}

TEST_F(DeliveryClientTest, ARegionThatNoDemandHasReportedCannotBeRetired) {
  deliver_and_hold(4);

  EXPECT_FALSE(client_.retire(kObject, 4));
  publish();
  EXPECT_TRUE(client_.retire(kObject, 4));
}

TEST_F(DeliveryClientTest, ARetiredRegionCanBeHeldAgain) {
  deliver_and_hold(4);
  publish();
  ASSERT_TRUE(client_.retire(kObject, 4));
  client_.answer_stored(kObject, 4);

  EXPECT_EQ(publish().have.size(), 1u);
  (void)client_.on_chunk(echo(), now_);
  EXPECT_THAT(client_.take_released(kObject), IsEmpty());
}

TEST_F(DeliveryClientTest, ARetiredRegionIsNotRequestedBeforeItsRelease) {
  deliver_and_hold(4);
  publish();
  ASSERT_TRUE(client_.retire(kObject, 4));
  client_.set_wanted(kObject, {{4, 0}});
  EXPECT_THAT(publish().wanted, IsEmpty());
  (void)client_.on_chunk(echo(), now_);
  ASSERT_THAT(client_.take_released(kObject), ElementsAre(4u));

  client_.set_wanted(kObject, {{4, 0}, {5, 0}});

  EXPECT_EQ(publish().wanted.size(), 2u);
}

TEST_F(DeliveryClientTest, ALateHostIsReplacedByAnotherHostOfTheObject) {
  EXPECT_EQ(client_.serving_host(kObject), kHost);
  now_ += 300 * kMs;
  (void)client_.demand(now_);
  EXPECT_EQ(client_.serving_host(kObject), kHost) << "no other host is live";

  client_.on_host_heartbeat(kOtherHost, 3, now_);

  const std::uint32_t epoch_before = epoch_;
  const Demand demand = publish();
  EXPECT_EQ(demand.serving_host, kOtherHost);
  EXPECT_EQ(demand.stream, stream_id({kSession, kOtherHost, 3, 0}, kReceiver, kObject));
  EXPECT_GT(demand.epoch, epoch_before);
}

TEST_F(DeliveryClientTest, WithoutAHostRetiredRegionsAreReleasedAndNoDemandIsPublished) {
  deliver_and_hold(4);
  publish();
  ASSERT_TRUE(client_.retire(kObject, 4));
  client_.on_host_gone(kHost);

  EXPECT_FALSE(client_.demand(now_ += 1000 * kMs));
  EXPECT_EQ(client_.serving_host(kObject), 0u);
  EXPECT_THAT(client_.take_released(kObject), ElementsAre(4u));
}

TEST_F(DeliveryClientTest, ARestartedHostBeginsANewStream) {
  deliver_and_hold(4);
  const Demand before = publish();
  client_.on_host_heartbeat(kHost, 6, now_);

  const Demand demand = publish();

  EXPECT_GT(before.received, 0u);
  EXPECT_EQ(demand.stream, stream_id({kSession, kHost, 6, 0}, kReceiver, kObject));
  EXPECT_EQ(demand.received, 0u);
  EXPECT_EQ(demand.have.size(), 1u);
}

TEST_F(DeliveryClientTest, RepeatsADemandWithGrowingIntervalsWhileAnAnswerIsDue) {
  client_.set_wanted(kObject, {{4, 0}});
  std::uint32_t epoch = publish().epoch;
  std::int64_t last_interval = 0;
  for (int i = 0; i < 8; ++i) {
    const std::int64_t published = now_;
    std::optional<Demand> again;
    while (!(again = client_.demand(now_))) now_ += kMs / 10;
    EXPECT_EQ(again->epoch, ++epoch) << "the host answers each epoch once";
    EXPECT_LE(now_ - published, i == 0 ? 5 * kMs : DeliverySettings{}.repeat_ns);
    EXPECT_GE(now_ - published, last_interval);
    last_interval = now_ - published;
  }
  EXPECT_EQ(last_interval, DeliverySettings{}.repeat_ns);
}

TEST_F(DeliveryClientTest, RepeatsAnUnchangedDemandAfterTheKeepAlivePeriodWhenNoAnswerIsDue) {
  const Demand demand = publish();
  EXPECT_FALSE(client_.demand(now_ + 499 * kMs));
  client_.on_host_heartbeat(kHost, 5, now_ + 499 * kMs);

  const std::optional<Demand> again = client_.demand(now_ + 500 * kMs);

  ASSERT_TRUE(again);
  EXPECT_EQ(again->epoch, demand.epoch);
}

TEST_F(DeliveryClientTest, AnEchoAloneCausesNoDemand) {
  publish();
  (void)client_.on_chunk(echo(), now_);

  EXPECT_FALSE(client_.demand(now_ += 10 * kMs)) << "echo and demand would cause each other endlessly";
}

TEST_F(DeliveryClientTest, AChangeIsPublishedAfterTheDemandInterval) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  client_.set_wanted(kObject, {{5, DeliverySettings{}.urgent_us}});

  EXPECT_FALSE(client_.demand(now_ + 4 * kMs));
  EXPECT_TRUE(client_.demand(now_ + 5 * kMs));
}

TEST_F(DeliveryClientTest, IncompleteMessagesStayWithinTheirBound) {
  DeliverySettings settings;
  settings.max_partial_bytes = 10'000;
  DeliveryClient client{kReceiver, settings};
  client.on_catalogue(catalogue_entry(kHost));
  client.on_host_heartbeat(kHost, 5, now_);
  client.open(kObject, kDigest);
  for (std::uint32_t region = 0; region < 1000; ++region) {
    (void)client.on_chunk(chunks(region, std::string(2000, 'x'), 2).at(0), now_ + region);
    ASSERT_LE(client.partial_bytes(), settings.max_partial_bytes);
  }
  EXPECT_GT(client.partial_bytes(), 5'000u);
  (void)client.demand(now_ + 3000 * kMs);
  EXPECT_EQ(client.partial_bytes(), 0u) << "no new chunk arrived within the timeout";
}

TEST_F(DeliveryClientTest, TheNumberOfIncompleteMessagesStaysWithinItsBound) {
  const std::size_t max = DeliverySettings{}.max_partials;
  const auto count = static_cast<std::uint32_t>(2 * max);
  for (const BulkChunk& chunk : first_pieces(count)) {
    (void)client_.on_chunk(chunk, now_ += kMs / 100);
    ASSERT_LE(client_.sizes().partials, max);
  }

  EXPECT_EQ(client_.sizes().partials, max);
  EXPECT_FALSE(receive({second_piece(0)})) << "the first pieces of the oldest messages were dropped";
  EXPECT_TRUE(receive({second_piece(count - 1)}));
}

TEST_F(DeliveryClientTest, ManyIncompleteMessagesAreDroppedInAShortTime) {
  using Clock = std::chrono::steady_clock;
  constexpr std::uint32_t kCount = 200'000;
  DeliverySettings settings;
  settings.max_partials = kCount;
  DeliveryClient client{kReceiver, settings};
  client.on_catalogue(catalogue_entry(kHost));
  client.on_host_heartbeat(kHost, 5, now_);
  client.open(kObject, kDigest);
  for (const BulkChunk& chunk : first_pieces(kCount)) (void)client.on_chunk(chunk, now_ += kMs / 10);
  ASSERT_EQ(client.sizes().partials, kCount);

  const Clock::time_point begin = Clock::now();
  (void)client.demand(now_ + settings.partial_timeout_ns);

  EXPECT_LT(Clock::now() - begin, std::chrono::seconds{20}) << "a search for the oldest among all takes minutes";
  EXPECT_EQ(client.sizes().partials, 0u);
  EXPECT_EQ(client.partial_bytes(), 0u);
}

TEST_F(DeliveryClientTest, AHostWithIncarnationZeroServesAnObject) {
  for (const bool opens_first : {false, true}) {
    sequence_ = 0;
    DeliveryClient client{kReceiver, DeliverySettings{}};
    if (opens_first) client.open(kObject, kDigest);
    CatalogueEntry entry = catalogue_entry(kHost);
    entry.origin.incarnation = 0;
    client.on_catalogue(entry);
    if (!opens_first) client.open(kObject, kDigest);
    EXPECT_FALSE(client.demand(now_)) << "no heartbeat has arrived";
    client.on_host_heartbeat(kHost, 0, now_);

    const std::optional<Demand> demand = client.demand(now_);
    ASSERT_TRUE(demand);
    EXPECT_EQ(demand->serving_host, kHost);
    EXPECT_EQ(demand->stream, stream_id({kSession, kHost, 0, 0}, kReceiver, kObject));
    BulkChunk base = chunks(spm::kNone, "base", 1).at(0);
    base.stream = demand->stream;
    EXPECT_EQ(client.on_chunk(base, now_).size(), 1u);
    EXPECT_THAT(client.take_released(kObject), IsEmpty());
  }
}

TEST_F(DeliveryClientTest, AHostWithIncarnationZeroReplacesTheHostOfAnOpenObject) {
  deliver_and_hold(4);
  publish();
  ASSERT_TRUE(client_.retire(kObject, 4));
  now_ += 300 * kMs;
  for (const std::uint64_t host : {kOtherHost, kOtherHost + 1}) {  // known when the object was opened, and new
    client_.on_catalogue(catalogue_entry(host));
    client_.on_host_heartbeat(host, 0, now_);

    const Demand demand = publish();

    EXPECT_EQ(demand.serving_host, host);
    EXPECT_EQ(demand.stream, stream_id({kSession, host, 0, 0}, kReceiver, kObject));
    EXPECT_THAT(client_.take_released(kObject), IsEmpty()) << "the new host has not echoed the demand";
    client_.on_host_gone(host);
  }
}

TEST_F(DeliveryClientTest, APageIsRequestedUntilItIsStored) {
  constexpr std::uint32_t kPage = kFirstPage + 7;
  client_.set_wanted(kObject, {{kPage, 0}, {3, 10}});
  const auto wants_page = [](const Demand& demand) {
    return std::any_of(demand.wanted.begin(), demand.wanted.end(),
                       [](const Wanted& wanted) { return wanted.region == kPage; });
  };
  EXPECT_TRUE(wants_page(publish()));
  auto message = receive(chunks(kPage, "page", 2));
  ASSERT_TRUE(message);
  EXPECT_EQ(message->kind, BulkKind::kRegion);
  EXPECT_EQ(message->region, kPage);
  client_.answer_refused(kObject, kPage);
  EXPECT_TRUE(wants_page(publish()));
  ASSERT_TRUE(receive(chunks(kPage, "page", 1)));
  client_.answer_page_stored(kObject, kPage);
  const Demand demand = publish();
  EXPECT_FALSE(wants_page(demand));
  EXPECT_THAT(demand.have, testing::IsEmpty()) << "a page is no region";
  const std::uint64_t stale = client_.counters().stale;
  EXPECT_FALSE(receive(chunks(kPage, "page", 1)));
  EXPECT_EQ(client_.counters().stale, stale + 1);
}

TEST_F(DeliveryClientTest, APieceOfANumberThatIsNeitherARegionNorAPageIsForeign) {
  publish();
  for (const std::uint32_t number : {kRegions, kFirstPage - 1, kFirstPage + spm::kPageIds}) {
    const std::uint64_t foreign = client_.counters().foreign;
    EXPECT_FALSE(receive(chunks(number, "x", 1)));
    EXPECT_EQ(client_.counters().foreign, foreign + 1) << number;
  }
}

TEST_F(DeliveryClientTest, AHostThatDoesNotOfferTheObjectCannotSendItsBaseMesh) {
  DeliveryClient client{kReceiver, DeliverySettings{}};
  client.on_catalogue(catalogue_entry(kHost));
  CatalogueEntry other_object = catalogue_entry(kOtherHost), other_model = catalogue_entry(kOtherHost + 1);
  other_object.object_id = kObject + 1;
  other_model.summary.digest = kDigest + 1;
  client.on_catalogue(other_object);
  client.on_catalogue(other_model);
  client.open(kObject, kDigest);
  for (const std::uint64_t host : {kHost, kOtherHost, kOtherHost + 1}) client.on_host_heartbeat(host, 5, now_);
  ASSERT_EQ(client.demand(now_)->serving_host, kHost);

  for (const std::uint64_t host : {kOtherHost, kOtherHost + 1}) {
    BulkChunk forged = chunks(spm::kNone, "forged", 1).at(0);
    forged.stream = stream_id({kSession, host, 5, 0}, kReceiver, kObject);
    forged.is_from_member = true;
    forged.senders = {host};
    EXPECT_THAT(client.on_chunk(forged, now_), IsEmpty());
  }
  EXPECT_EQ(client.counters().foreign, 2u);
  sequence_ = 0;
  const std::vector<DeliveryClient::Message> messages = client.on_chunk(chunks(spm::kNone, "base", 1).at(0), now_);
  ASSERT_EQ(messages.size(), 1u);
  EXPECT_EQ(std::string(messages[0].bytes.begin(), messages[0].bytes.end()), "base");
}

TEST_F(DeliveryClientTest, ChunksOfAWithdrawnObjectAreRequestedAgainWhenItIsOfferedAgain) {
  client_.set_wanted(kObject, {{4, 0}, {5, 0}});
  publish();
  CatalogueEntry entry = catalogue_entry(kHost);
  entry.withdrawn = true;
  client_.on_catalogue(entry);
  const std::vector<BulkChunk> ignored = chunks(4, "x", 1);
  EXPECT_FALSE(receive(ignored));
  client_.on_catalogue(catalogue_entry(kHost));

  EXPECT_TRUE(receive(chunks(5, "y", 1)));

  const Demand demand = publish();
  ASSERT_EQ(demand.gaps.size(), 1u);
  EXPECT_EQ(demand.gaps[0].first, ignored[0].sequence);
}

TEST_F(DeliveryClientTest, AHostThatSendsNoChunksIsReplacedByTheNextHostOfTheObject) {
  const std::int64_t timeout = DeliverySettings{}.no_answer_ns;
  const std::vector<std::uint64_t> hosts{kHost, kOtherHost, kOtherHost + 1};
  client_.on_catalogue(catalogue_entry(hosts[2]));
  client_.set_wanted(kObject, {{4, 0}});
  run_with_heartbeats(hosts, timeout - 100 * kMs);
  EXPECT_EQ(client_.serving_host(kObject), hosts[0]);
  receive({echo()});
  run_with_heartbeats(hosts, timeout - 100 * kMs);
  EXPECT_EQ(client_.serving_host(kObject), hosts[0]) << "the host has answered";

  for (const std::uint64_t next : {hosts[1], hosts[2], hosts[0]}) {
    run_with_heartbeats(hosts, timeout);
    EXPECT_EQ(client_.serving_host(kObject), next);
  }
}

TEST_F(DeliveryClientTest, AHostThatSendsNoChunksRemainsWithoutAnotherHostOrAnAnswerDue) {
  const std::int64_t timeout = DeliverySettings{}.no_answer_ns;
  run_with_heartbeats({kHost, kOtherHost}, 2 * timeout);
  EXPECT_EQ(client_.serving_host(kObject), kHost) << "no answer is due";

  client_.set_wanted(kObject, {{4, 0}});
  run_with_heartbeats({kHost}, 2 * timeout);
  EXPECT_EQ(client_.serving_host(kObject), kHost) << "the other host is late";
  EXPECT_EQ(client_.counters().host_changes, 0u);
}

TEST_F(DeliveryClientTest, ContinuesAfterOneChunkWithAnImplausibleSequence) {
  for (std::uint32_t region = 0; region < 20; ++region) deliver_and_hold(region);
  BulkChunk wrong = echo();
  wrong.sequence = 0xfffffff0;
  receive({wrong});
  --sequence_;
  client_.set_wanted(kObject, {{20, 0}});
  const Demand demand = publish();
  EXPECT_TRUE(demand.gaps.empty());
  EXPECT_LE(demand.newest, sequence_);
  deliver_and_hold(20);
  EXPECT_EQ(publish().received, sequence_);
}

TEST_F(DeliveryClientTest, AnImplausibleSendingTimeDoesNotChangeTheReportedDelay) {
  for (std::uint32_t region = 0; region < 20; ++region) deliver_and_hold(region);
  publish_after_change();
  now_ += kMs;
  BulkChunk delayed = echo(), wrong = echo();
  delayed.sent_us -= 1000;
  wrong.sent_us += 1u << 30;
  receive({delayed, wrong});
  EXPECT_EQ(publish_after_change().one_way_us, 1000u);
}

// A host numbers its starts, so it could offer an object any number of times.
TEST_F(DeliveryClientTest, TheOffersOfAHostAreLimited) {
  CatalogueEntry entry = catalogue_entry(kOtherHost);
  for (std::uint64_t incarnation = 6; incarnation < 10'000; ++incarnation) {
    entry.origin.incarnation = incarnation;
    client_.on_catalogue(entry);
  }
  EXPECT_LE(client_.sizes().offers, DeliveryClient::kMaxOffers + 1);
  EXPECT_TRUE(client_.is_offered(kObject, kDigest));
  CatalogueEntry other = catalogue_entry(kHost);
  other.object_id = kObject + 1;
  client_.on_catalogue(other);
  EXPECT_TRUE(client_.is_offered(kObject + 1, kDigest)) << "another host";
}

TEST_F(DeliveryClientTest, AHostThatIsAbsentForLongIsDroppedWithItsStreams) {
  const DeliveryClient::Sizes before = client_.sizes();
  for (std::uint64_t host = 1000; host < 1100; ++host) {
    client_.on_catalogue(catalogue_entry(host));
    client_.on_host_heartbeat(host, 5, now_);
  }
  EXPECT_EQ(client_.sizes().hosts, before.hosts + 100);
  for (std::uint64_t host = 1000; host < 1100; ++host) client_.on_host_gone(host);
  (void)client_.demand(now_);
  const DeliveryClient::Sizes after_silence = client_.sizes();
  client_.on_host_heartbeat(kHost, 5, now_ += DeliverySettings{}.forget_host_ns);
  (void)client_.demand(now_);

  EXPECT_EQ(after_silence.offers, before.offers + 100)
      << "a host that returns within the DDS lease does not send its catalogue again";
  EXPECT_EQ(client_.sizes().hosts, 1u) << "the other host was never live";
  EXPECT_EQ(client_.sizes().streams, 1u);
  EXPECT_EQ(client_.sizes().offers, 1u);
  EXPECT_EQ(client_.serving_host(kObject), kHost);
}

TEST_F(DeliveryClientTest, TheStateOfAClosedObjectIsFreed) {
  const DeliveryClient::Sizes before = client_.sizes();
  for (std::uint64_t object = 1000; object < 1100; ++object) {
    CatalogueEntry entry = catalogue_entry(kHost);
    entry.object_id = object;
    client_.on_catalogue(entry);
    client_.open(object, kDigest);
    BulkChunk chunk = chunks(spm::kNone, std::string(2000, 'x'), 2).at(0);
    chunk.stream = stream_id({kSession, kHost, 5, 0}, kReceiver, object);
    (void)client_.on_chunk(chunk, now_);
  }
  EXPECT_GT(client_.partial_bytes(), 100'000u);
  for (std::uint64_t object = 1000; object < 1100; ++object) client_.close(object);

  EXPECT_EQ(client_.partial_bytes(), 0u);
  EXPECT_EQ(client_.sizes().objects, before.objects);
  EXPECT_EQ(client_.sizes().streams, before.streams);
}

}  // namespace
}  // namespace tactus::session
