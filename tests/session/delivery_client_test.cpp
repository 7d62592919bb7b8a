#include "session/delivery_client.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

namespace tactus::session {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr std::uint64_t kSession = 1, kHost = 10, kOtherHost = 11, kHrtc = 20, kObject = 30, kDigest = 99;
constexpr Origin kSelf{kSession, kHrtc, 7, 0};
constexpr std::int64_t kMs = 1'000'000;

class DeliveryClientTest : public testing::Test {
 protected:
  DeliveryClientTest() : client_{kSelf, DeliverySettings{}} {
    for (const std::uint64_t host : {kHost, kOtherHost}) client_.on_catalogue(entry(host));
    client_.on_host_heartbeat(kHost, 5, now_);
    client_.open(kObject, kDigest);
    give_base();
  }

  static CatalogueEntry entry(std::uint64_t host) {
    CatalogueEntry e;
    e.origin = {kSession, host, 5, 0};
    e.object_id = kObject;
    e.summary.digest = kDigest;
    return e;
  }

  void give_base() {
    ASSERT_TRUE(client_.demand(now_)->need_base);
    ASSERT_TRUE(take(chunks(spm::kNone, "base", 1)));
    client_.answer_base_stored(kObject);
  }

  /// Chunks of one message that holds `text`.
  std::vector<BulkChunk> chunks(std::uint32_t region, const std::string& text, std::uint32_t parts) {
    std::vector<BulkChunk> all(parts);
    const std::vector<std::uint8_t> bytes(text.begin(), text.end());
    const std::size_t size = (text.size() + parts - 1) / parts;
    for (std::uint32_t i = 0; i < parts; ++i) {
      BulkChunk& c = all[i];
      c.stream = stream_id({kSession, kHost, 5, 0}, kSelf, kObject);
      c.sent_us = static_cast<std::uint32_t>(now_ / 1000);
      c.sequence = ++sequence_;
      c.epoch = epoch_;
      const std::string part = text.substr(std::min(text.size(), i * size), size);
      c.pieces.push_back({region, i, parts, checksum_of(bytes), {part.begin(), part.end()}});
    }
    return all;
  }
  BulkChunk echo() {
    BulkChunk c = chunks(spm::kNone, "", 1).at(0);
    c.pieces.clear();
    return c;
  }

  /// The demand due now; its epoch becomes that of later chunks.
  Demand publish() {
    const std::optional<Demand> d = client_.demand(now_ += 10 * kMs);
    if (!d) {
      ADD_FAILURE() << "no demand due";
      return {};
    }
    epoch_ = d->epoch;
    return *d;
  }

  Demand publish_after_change() {
    client_.set_wanted(kObject, {{next_region_++, 0}});
    return publish();
  }

  std::optional<DeliveryClient::Message> take(const std::vector<BulkChunk>& all) {
    std::optional<DeliveryClient::Message> message;
    for (const BulkChunk& c : all) {
      for (DeliveryClient::Message& complete : client_.on_chunk(c, now_)) message = std::move(complete);
    }
    return message;
  }

  void hold(std::uint32_t region) {
    ASSERT_TRUE(take(chunks(region, "region " + std::to_string(region), 2)));
    client_.answer_stored(kObject, region);
  }

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
  take({echo()});
  const std::int64_t first = client_.round_trip_ns();
  for (std::uint32_t i = 0; i < 100; ++i) {
    client_.set_wanted(kObject, {{5 + i, 0}});
    publish();
    now_ += 8 * kMs;
    take({echo()});
  }

  EXPECT_NEAR(static_cast<double>(first), 40 * kMs, 10 * kMs) << "smoothed with the round trip of the base mesh";
  EXPECT_NEAR(static_cast<double>(client_.round_trip_ns()), 8 * kMs, kMs);
}

TEST_F(DeliveryClientTest, CreditGrowsWithRateTimesRoundTripUpToTheRoom) {
  const std::uint32_t at_first = publish_after_change().credit;
  const std::string text(1100, 'x');
  std::uint32_t credit = 0;
  for (int trip = 0; trip < 20; ++trip) {
    const Demand demand = publish_after_change();
    credit = demand.credit;
    now_ += 90 * kMs;
    // 20 MB/s: the whole credit, up to the rate of the link.
    for (std::uint32_t sent = 0; sent < std::min(credit, 2'000'000u); sent += 1100) take(chunks(1000, text, 2000));
  }
  client_.limit_credit(70'000);
  const std::uint32_t with_limit = publish_after_change().credit;

  EXPECT_EQ(at_first, DeliverySettings{}.credit);
  EXPECT_GT(credit, 4 * at_first);
  EXPECT_LE(credit, DeliverySettings{}.max_credit);
  EXPECT_EQ(with_limit, 70'000u);
}

TEST_F(DeliveryClientTest, NewRoomIsPublishedAtOnceWhileAnAnswerIsDue) {
  client_.limit_credit(0);
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  take({echo()});
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
  EXPECT_FALSE(client_.demand(published + settings.urgent_interval_ns)) << "no contact is near";

  client_.set_wanted(kObject, {{4, 2 * settings.urgent_us}, {6, settings.urgent_us / 2}});
  ASSERT_TRUE(client_.demand(published + settings.urgent_interval_ns));

  client_.set_wanted(kObject, {{6, settings.urgent_us / 4}});
  EXPECT_FALSE(client_.demand(published + 2 * settings.urgent_interval_ns)) << "it has been requested";
}

TEST_F(DeliveryClientTest, JoinsChunksInAnyOrderAndOnce) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  std::vector<BulkChunk> all = chunks(4, "what the region holds", 5);
  std::swap(all[0], all[3]);
  std::swap(all[2], all[4]);
  all.insert(all.begin() + 2, all[1]);

  const auto message = take(all);

  ASSERT_TRUE(message);
  EXPECT_EQ(std::string(message->bytes.begin(), message->bytes.end()), "what the region holds");
  EXPECT_EQ(message->region, 4u);
  EXPECT_FALSE(take(all)) << "delivered and not answered yet";
  EXPECT_EQ(client_.partial_bytes(), 0u);
}

TEST_F(DeliveryClientTest, AChunkCompletesSeveralMessagesAndBeginsAnother) {
  client_.set_wanted(kObject, {{4, 0}, {5, 0}, {6, 0}});
  publish();
  std::vector<BulkChunk> first = chunks(4, "begun before", 2);
  const std::vector<BulkChunk> whole = chunks(5, "whole", 1), last = chunks(6, "ends later", 2);
  ASSERT_FALSE(take({first[0]}));
  first[1].pieces.push_back(whole[0].pieces[0]);
  first[1].pieces.push_back(last[0].pieces[0]);

  const std::vector<DeliveryClient::Message> messages = client_.on_chunk(first[1], now_);

  ASSERT_EQ(messages.size(), 2u);
  EXPECT_EQ(messages[0].region, 4u);
  EXPECT_EQ(messages[1].region, 5u);
  client_.answer_stored(kObject, 4);
  EXPECT_EQ(publish().received, first[1].sequence - 1) << "region 5 waits for its answer";
  client_.answer_stored(kObject, 5);
  EXPECT_EQ(publish().received, first[1].sequence);
  EXPECT_TRUE(take({last[1]}));
}

TEST_F(DeliveryClientTest, ACancelledMessageMayComeAgainWithOtherParts) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  const std::string text = "what region four has to say";
  // The same number of parts and bytes, but a shorter first part.
  std::vector<BulkChunk> again = chunks(4, text, 2);
  const std::vector<BulkChunk> cancelled = chunks(4, text, 2);
  std::vector<std::uint8_t>& first = again[0].pieces[0].payload;
  std::vector<std::uint8_t>& second = again[1].pieces[0].payload;
  second.insert(second.begin(), first.end() - 5, first.end());
  first.resize(first.size() - 5);
  for (BulkChunk& chunk : again) chunk.sequence = ++sequence_;

  ASSERT_FALSE(take({cancelled[0]}));
  const auto message = take(again);

  ASSERT_TRUE(message);
  EXPECT_EQ(std::string(message->bytes.begin(), message->bytes.end()), text);
  EXPECT_EQ(client_.counters().corrupt, 0u);
}

TEST_F(DeliveryClientTest, DropsAMessageWhoseChecksumIsWrong) {
  std::vector<BulkChunk> all = chunks(4, "what the region holds", 3);
  all[1].pieces[0].payload[0] ^= 1;

  EXPECT_FALSE(take(all));
  EXPECT_EQ(client_.counters().corrupt, 1u);
}

TEST_F(DeliveryClientTest, IgnoresForeignChunks) {
  const auto other = [](std::uint64_t session, std::uint64_t host, std::uint64_t incarnation, std::uint64_t hrtc,
                        std::uint64_t object) {
    return stream_id({session, host, incarnation, 0}, {session, hrtc, 7, 0}, object);
  };
  const auto variations = std::vector<std::function<void(BulkChunk&)>>{
      [&](BulkChunk& c) { c.stream = other(2, kHost, 5, kHrtc, kObject); },
      [&](BulkChunk& c) { c.stream = other(kSession, kHost, 5, 21, kObject); },
      [&](BulkChunk& c) { c.stream = other(kSession, kHost, 5, kHrtc, 31); },
      [&](BulkChunk& c) { c.stream = other(kSession, kHost, 4, kHrtc, kObject); },
      [&](BulkChunk& c) { c.stream = other(kSession, 12, 5, kHrtc, kObject); },
      [](BulkChunk& c) { c.pieces[0].index = 1; },
      [](BulkChunk& c) {
        c.pieces.push_back({spm::kNone, 0, 1, 0, {1}});
      },
      [](BulkChunk& c) { c.epoch += 100; },
      [](BulkChunk& c) { c.pieces[0].payload.resize(kMaxPayload + 1); }};
  for (const auto& vary : variations) {
    std::vector<BulkChunk> all = chunks(4, "x", 1);
    vary(all[0]);
    EXPECT_FALSE(take(all));
  }
  EXPECT_EQ(client_.counters().foreign, variations.size());
}

TEST_F(DeliveryClientTest, AMessageIsNotReceivedUntilTheCallerAnswersIt) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  const std::vector<BulkChunk> all = chunks(4, "abc", 3);
  ASSERT_TRUE(take(all));
  EXPECT_EQ(publish().received, all.back().sequence - 1);

  client_.answer_stored(kObject, 4);

  const Demand d = publish();
  EXPECT_EQ(d.received, all.back().sequence);
  ASSERT_EQ(d.have.size(), 1u);
  EXPECT_THAT(d.wanted, IsEmpty());
}

TEST_F(DeliveryClientTest, AnOldHoleIsReportedAndClosedByTheHostsAnswer) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  std::vector<BulkChunk> all = chunks(4, "abcd", 4);
  const std::uint32_t first = all[0].sequence;
  all.erase(all.begin() + 1);
  EXPECT_FALSE(take(all));
  const std::optional<Demand> young = client_.demand(now_ + DeliverySettings{}.urgent_interval_ns);
  EXPECT_FALSE(young) << "chunks may overtake each other";

  const Demand d = publish();

  EXPECT_EQ(d.received, first);
  EXPECT_EQ(d.newest, first + 3);
  ASSERT_EQ(d.gaps.size(), 1u);
  EXPECT_EQ(d.gaps[0].first, first + 1);
  EXPECT_EQ(d.gaps[0].count, 1u);
  EXPECT_EQ(client_.counters().lost, 1u);
  EXPECT_EQ(publish_after_change().gaps.size(), 1u) << "until the host answers";
  (void)client_.on_chunk(echo(), now_);
  const Demand after = publish_after_change();
  EXPECT_EQ(after.received, first + 4);
  EXPECT_TRUE(after.gaps.empty());
}

TEST_F(DeliveryClientTest, AFilledHoleIsNotReported) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  std::vector<BulkChunk> all = chunks(4, "abcde", 5);
  const std::uint32_t last = all.back().sequence;
  EXPECT_FALSE(take({all[4], all[0]}));
  EXPECT_FALSE(take({all[2]}));
  EXPECT_TRUE(take({all[3], all[1]}));
  client_.answer_stored(kObject, 4);

  const Demand d = publish();
  EXPECT_EQ(d.received, last);
  EXPECT_TRUE(d.gaps.empty());
}

TEST_F(DeliveryClientTest, ReportsTheMinOneWayDelaySinceTheLastDemand) {
  publish_after_change();
  std::vector<BulkChunk> all = chunks(4, "abc", 3);
  const auto sent_us = static_cast<std::uint32_t>(now_ / 1000);
  all[0].sent_us = sent_us - 700;
  all[1].sent_us = sent_us + 5;  // the clocks are independent
  all[2].sent_us = sent_us - 20;
  take(all);

  const Demand d = publish();
  EXPECT_EQ(d.arrivals, 3u);
  EXPECT_EQ(static_cast<std::int32_t>(d.one_way_us), -5);
  EXPECT_EQ(publish_after_change().arrivals, 0u);
}

TEST_F(DeliveryClientTest, ARetiredRegionIsReleasedAfterTheEchoAndAllEarlierChunks) {
  hold(4);
  publish();
  ASSERT_TRUE(client_.retire(kObject, 4));
  EXPECT_THAT(publish().have, IsEmpty());
  EXPECT_THAT(client_.take_released(kObject), IsEmpty());

  epoch_ -= 1;
  const std::vector<BulkChunk> before = chunks(5, "relies on region 4", 1);
  epoch_ += 1;
  EXPECT_FALSE(take({echo()}));
  EXPECT_THAT(client_.take_released(kObject), IsEmpty()) << "a message before the echo is still in flight";

  EXPECT_TRUE(take(before));
  EXPECT_THAT(client_.take_released(kObject), IsEmpty()) << "the message waits for the caller's answer";
  client_.answer_stored(kObject, 5);
  EXPECT_THAT(client_.take_released(kObject), ElementsAre(4u));
  EXPECT_THAT(client_.take_released(kObject), IsEmpty());
}

TEST_F(DeliveryClientTest, AParkedMessageCountsAsInFlightButDelaysNoRelease) {
  hold(4);
  publish();
  client_.set_wanted(kObject, {{5, 0}});
  ASSERT_TRUE(client_.retire(kObject, 4));
  publish();
  epoch_ -= 1;
  const std::vector<BulkChunk> waits = chunks(5, "relies on region 4", 1);
  epoch_ += 1;
  ASSERT_TRUE(take(waits));
  EXPECT_FALSE(take({echo()}));
  EXPECT_THAT(client_.take_released(kObject), IsEmpty());

  client_.postpone_answer(kObject, 5);

  EXPECT_THAT(client_.take_released(kObject), ElementsAre(4u));
  EXPECT_EQ(publish_after_change().received, waits.back().sequence - 1);
  client_.answer_refused(kObject, 5);
  EXPECT_GT(publish().received, waits.back().sequence);
}

TEST_F(DeliveryClientTest, APublishedCreditHoldsForARoundTripWhateverIsPublishedLater) {
  client_.limit_credit(200'000);
  publish_after_change();
  client_.limit_credit(50'000);
  publish_after_change();
  EXPECT_EQ(client_.granted_credit(now_), 200'000u);
  EXPECT_EQ(client_.granted_credit(now_ + 1000 * kMs), 50'000u) << "the last one holds until the next is published";

  client_.limit_credit(80'000);
  publish_after_change();
  EXPECT_EQ(client_.granted_credit(now_), 80'000u);
}

TEST_F(DeliveryClientTest, AMessageFromBeforeARetirementIsDroppedAfterTheRelease) {
  hold(4);
  publish();
  ASSERT_TRUE(client_.retire(kObject, 4));
  const std::uint32_t old_epoch = epoch_;
  publish();
  (void)client_.on_chunk(echo(), now_);
  ASSERT_THAT(client_.take_released(kObject), ElementsAre(4u));

  epoch_ = old_epoch;

  EXPECT_FALSE(take(chunks(5, "relies on region 4", 1)));
  EXPECT_EQ(client_.counters().stale, 1u);
}

TEST_F(DeliveryClientTest, AMessageBegunBeforeARetirementIsValidIfItsHostContinuesIt) {
  hold(4);
  publish();
  const std::vector<BulkChunk> begun = chunks(5, "relies on nothing of region 4", 2);
  (void)client_.on_chunk(begun[0], now_);
  ASSERT_TRUE(client_.retire(kObject, 4));
  publish();
  sequence_ -= 1;
  (void)client_.on_chunk(echo(), now_);
  ASSERT_THAT(client_.take_released(kObject), ElementsAre(4u));

  BulkChunk rest = begun[1];
  rest.epoch = epoch_;
  rest.sequence = ++sequence_;

  EXPECT_TRUE(take({rest}));
}

TEST_F(DeliveryClientTest, ARegionThatNoDemandHasReportedCannotBeRetired) {
  hold(4);

  EXPECT_FALSE(client_.retire(kObject, 4));
  publish();
  EXPECT_TRUE(client_.retire(kObject, 4));
}

TEST_F(DeliveryClientTest, ARetiredRegionCanBeHeldAgain) {
  hold(4);
  publish();
  ASSERT_TRUE(client_.retire(kObject, 4));
  client_.answer_stored(kObject, 4);

  EXPECT_EQ(publish().have.size(), 1u);
  (void)client_.on_chunk(echo(), now_);
  EXPECT_THAT(client_.take_released(kObject), IsEmpty());
}

TEST_F(DeliveryClientTest, ARetiredRegionIsNotRequestedBeforeItsRelease) {
  hold(4);
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
  const Demand d = publish();
  EXPECT_EQ(d.serving_host, kOtherHost);
  EXPECT_EQ(d.stream, stream_id({kSession, kOtherHost, 3, 0}, kSelf, kObject));
  EXPECT_GT(d.epoch, epoch_before);
}

TEST_F(DeliveryClientTest, WithoutAnyHostRetiredRegionsAreReleasedAndNothingIsPublished) {
  hold(4);
  publish();
  ASSERT_TRUE(client_.retire(kObject, 4));
  client_.on_host_gone(kHost);

  EXPECT_FALSE(client_.demand(now_ += 1000 * kMs));
  EXPECT_EQ(client_.serving_host(kObject), 0u);
  EXPECT_THAT(client_.take_released(kObject), ElementsAre(4u));
}

TEST_F(DeliveryClientTest, ARestartedHostBeginsANewStream) {
  hold(4);
  const Demand before = publish();
  client_.on_host_heartbeat(kHost, 6, now_);

  const Demand d = publish();

  EXPECT_GT(before.received, 0u);
  EXPECT_EQ(d.stream, stream_id({kSession, kHost, 6, 0}, kSelf, kObject));
  EXPECT_EQ(d.received, 0u);
  EXPECT_EQ(d.have.size(), 1u);
}

TEST_F(DeliveryClientTest, RepeatsADemandWithGrowingIntervalsWhileAnAnswerIsDue) {
  client_.set_wanted(kObject, {{4, 0}});
  std::uint32_t epoch = publish().epoch;
  std::int64_t before = 0;
  for (int i = 0; i < 8; ++i) {
    const std::int64_t requested = now_;
    std::optional<Demand> again;
    while (!(again = client_.demand(now_))) now_ += kMs / 10;
    EXPECT_EQ(again->epoch, ++epoch) << "the host answers each epoch once";
    EXPECT_LE(now_ - requested, i == 0 ? 5 * kMs : DeliverySettings{}.repeat_ns);
    EXPECT_GE(now_ - requested, before);
    before = now_ - requested;
  }
  EXPECT_EQ(before, DeliverySettings{}.repeat_ns);
}

TEST_F(DeliveryClientTest, AnUnchangedDemandRepeatsAtTheKeepAliveWhenNoAnswerIsDue) {
  const Demand d = publish();
  EXPECT_FALSE(client_.demand(now_ + 499 * kMs));
  client_.on_host_heartbeat(kHost, 5, now_ + 499 * kMs);

  const std::optional<Demand> again = client_.demand(now_ + 500 * kMs);

  ASSERT_TRUE(again);
  EXPECT_EQ(again->epoch, d.epoch);
}

TEST_F(DeliveryClientTest, AnEchoAloneCausesNoDemand) {
  publish();
  (void)client_.on_chunk(echo(), now_);

  EXPECT_FALSE(client_.demand(now_ += 10 * kMs)) << "echo and demand would cause each other for ever";
}

TEST_F(DeliveryClientTest, ChangesWaitForTheInterval) {
  client_.set_wanted(kObject, {{4, 0}});
  publish();
  client_.set_wanted(kObject, {{5, DeliverySettings{}.urgent_us}});

  EXPECT_FALSE(client_.demand(now_ + 4 * kMs));
  EXPECT_TRUE(client_.demand(now_ + 5 * kMs));
}

TEST_F(DeliveryClientTest, IncompleteMessagesStayWithinTheirBound) {
  DeliverySettings settings;
  settings.max_partial_bytes = 10'000;
  DeliveryClient client{kSelf, settings};
  client.on_catalogue(entry(kHost));
  client.on_host_heartbeat(kHost, 5, now_);
  client.open(kObject, kDigest);
  for (std::uint32_t region = 0; region < 1000; ++region) {
    (void)client.on_chunk(chunks(region, std::string(2000, 'x'), 2).at(0), now_ + region);
    ASSERT_LE(client.partial_bytes(), settings.max_partial_bytes);
  }
  EXPECT_GT(client.partial_bytes(), 5'000u);
  (void)client.demand(now_ + 3000 * kMs);
  EXPECT_EQ(client.partial_bytes(), 0u) << "no new chunk within the timeout";
}

TEST_F(DeliveryClientTest, GoesOnAfterOneChunkFromTheFarFuture) {
  for (std::uint32_t region = 0; region < 20; ++region) hold(region);
  BulkChunk wrong = echo();
  wrong.sequence = 0xfffffff0;
  take({wrong});
  --sequence_;
  client_.set_wanted(kObject, {{20, 0}});
  const Demand demand = publish();
  EXPECT_TRUE(demand.gaps.empty());
  EXPECT_LE(demand.newest, sequence_);
  hold(20);
  EXPECT_EQ(publish().received, sequence_);
}

TEST_F(DeliveryClientTest, OneSendingTimeFromTheFarFutureIsNotTakenForAShortDelay) {
  for (std::uint32_t region = 0; region < 20; ++region) hold(region);
  publish_after_change();
  now_ += kMs;
  BulkChunk late = echo(), wrong = echo();
  late.sent_us -= 1000;
  wrong.sent_us += 1u << 30;
  take({late, wrong});
  EXPECT_EQ(publish_after_change().one_way_us, 1000u);
}

TEST_F(DeliveryClientTest, AHostThatIsGoneForLongIsDroppedWithItsStreams) {
  const DeliveryClient::Sizes before = client_.sizes();
  for (std::uint64_t host = 1000; host < 1100; ++host) {
    client_.on_catalogue(entry(host));
    client_.on_host_heartbeat(host, 5, now_);
  }
  EXPECT_EQ(client_.sizes().hosts, before.hosts + 100);
  for (std::uint64_t host = 1000; host < 1100; ++host) client_.on_host_gone(host);
  (void)client_.demand(now_);
  const DeliveryClient::Sizes soon = client_.sizes();
  client_.on_host_heartbeat(kHost, 5, now_ += DeliverySettings{}.forget_host_ns);
  (void)client_.demand(now_);

  EXPECT_EQ(soon.offers, before.offers + 100) << "a host that comes back within the DDS lease sends no catalogue again";
  EXPECT_EQ(client_.sizes().hosts, 1u) << "the other host was never live";
  EXPECT_EQ(client_.sizes().streams, 1u);
  EXPECT_EQ(client_.sizes().offers, 1u);
  EXPECT_EQ(client_.serving_host(kObject), kHost);
}

TEST_F(DeliveryClientTest, AClosedObjectIsFreed) {
  const DeliveryClient::Sizes before = client_.sizes();
  for (std::uint64_t object = 1000; object < 1100; ++object) {
    client_.open(object, kDigest);
    BulkChunk chunk = chunks(spm::kNone, std::string(2000, 'x'), 2).at(0);
    chunk.stream = stream_id({kSession, kHost, 5, 0}, kSelf, object);
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
