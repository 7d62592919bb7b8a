#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <string>

#include "support.hpp"
#include "wire/rate_limit.hpp"

namespace tactus::wire::test {
namespace {

/// Two participants of one session, each with its own sockets, in one process.
class TwoPrograms : public testing::Test {
 protected:
  const std::string session_ = unique_session("two");
  Participants alpha_{address(session_, "alpha")};
  Participants beta_{address(session_, "beta")};

  template <class Sample>
  void expect_round_trip(const TopicSpec<Sample>& topic, const EndpointOptions& options = {}) {
    SCOPED_TRACE(topic.profile + (" in partition '" + options.partition + "'"));
    Inbox<Sample> inbox;
    Reader<Sample> reader{beta_, topic, inbox.callback(), options};
    Writer<Sample> writer{alpha_, topic, options};
    const Sample sent = full_sample<Sample>(alpha_);

    const auto received = send_until_received(writer, inbox, sent);

    ASSERT_TRUE(received.has_value()) << "last invalid sample: " << writer.invalid_reason() << reader.invalid_reason();
    EXPECT_EQ(fields(*received), fields(sent));
    EXPECT_EQ(reader.counts().invalid, 0u) << reader.invalid_reason();
    // A sample may arrive before either endpoint is notified of the match.
    EXPECT_TRUE(eventually([&] { return writer.matched() == 1 && reader.matched() == 1; }));
  }

  template <class Sample>
  void expect_late_joiner_receives(const TopicSpec<Sample>& topic) {
    SCOPED_TRACE(topic.name);
    Writer<Sample> writer{alpha_, topic};
    const Sample sent = full_sample<Sample>(alpha_);
    ASSERT_EQ(writer.send(sent), SendStatus::kSent);

    Inbox<Sample> inbox;
    Reader<Sample> reader{beta_, topic, inbox.callback()};

    const auto received = inbox.next();
    ASSERT_TRUE(received.has_value());
    EXPECT_EQ(fields(*received), fields(sent));
  }
};

TEST_F(TwoPrograms, EveryFieldOfEveryTopicArrives) {
  topics::for_each([&](const auto& topic) {
    for (const EndpointOptions& options : partitions_of(topic)) expect_round_trip(topic, options);
  });
}

TEST_F(TwoPrograms, ThePartitionOfAUserHasOnlySamplesOfThisUser) {
  const EndpointOptions ann{user_partition("ann")};
  Inbox<ses::Intent> inbox;
  Reader<ses::Intent> reader{beta_, topics::kIntent, inbox.callback(), ann};
  Writer<ses::Intent> writer{alpha_, topics::kIntent, ann};
  auto intent = full_sample<ses::Intent>(alpha_);
  ASSERT_TRUE(send_until_received(writer, inbox, intent));
  intent.user_id = ses::id_of("bob");
  EXPECT_TRUE(eventually([&] { return writer.send(intent) == SendStatus::kSent && reader.counts().invalid > 0; }));
  EXPECT_THAT(reader.invalid_reason(), testing::HasSubstr("user_id: expected the user of the partition"));
}

TEST_F(TwoPrograms, AFloodOfSamplesIsLimitedToTheRateOfItsTopic) {
  std::atomic<std::uint32_t> arrived{0};
  Reader<ses::EmergencyStop> reader{beta_, topics::kStop, [&](ses::EmergencyStop&&) { ++arrived; }};
  Writer<ses::EmergencyStop> writer{alpha_, topics::kStop};
  const auto begin = std::chrono::steady_clock::now();
  const auto stop = full_sample<ses::EmergencyStop>(alpha_);
  EXPECT_TRUE(eventually([&] {
    EXPECT_EQ(writer.send(stop), SendStatus::kSent);
    return reader.counts().excess > 100;
  }));
  const std::uint32_t count = arrived;  // before the time, because samples still arrive
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  EXPECT_LE(count, topics::kStop.max_rate * seconds.count() + RateLimit::kMinBurst + 1);
}

TEST_F(TwoPrograms, ALateJoinerReceivesTransientLocalTopics) {
  expect_late_joiner_receives(topics::kCatalogue);
  expect_late_joiner_receives(topics::kControl);
  expect_late_joiner_receives(topics::kEnd);
}

TEST_F(TwoPrograms, ALateJoinerReceivesTheNewestEntryOfEachObject) {
  Writer<ses::CatalogueEntry> writer{alpha_, topics::kCatalogue};
  auto entry = full_sample<ses::CatalogueEntry>(alpha_);
  for (const char* object : {"a", "b", "c"}) {
    for (const std::uint32_t base_bytes : {1u, 2u}) {
      entry.object = object;
      entry.object_id = ses::id_of(object);
      entry.base_bytes = base_bytes;
      ASSERT_EQ(writer.send(entry), SendStatus::kSent);
    }
  }

  Inbox<ses::CatalogueEntry> inbox;
  Reader<ses::CatalogueEntry> reader{beta_, topics::kCatalogue, inbox.callback()};

  std::vector<std::pair<std::string, std::uint32_t>> received;
  for (int i = 0; i < 3; ++i) {
    const auto sample = inbox.next();
    ASSERT_TRUE(sample.has_value()) << "after " << i << " samples";
    received.emplace_back(sample->object, sample->base_bytes);
  }
  EXPECT_THAT(received,
              testing::UnorderedElementsAre(testing::Pair("a", 2u), testing::Pair("b", 2u), testing::Pair("c", 2u)));
}

TEST_F(TwoPrograms, ALateJoinerReceivesAllEntriesOfAHostAtOnce) {
  constexpr std::uint32_t kObjects = 400;
  Writer<ses::CatalogueEntry> writer{alpha_, topics::kCatalogue};
  auto entry = full_sample<ses::CatalogueEntry>(alpha_);
  for (std::uint32_t i = 0; i < kObjects; ++i) {
    entry.object = "object" + std::to_string(i);
    entry.object_id = ses::id_of(entry.object);
    ASSERT_EQ(writer.send(entry), SendStatus::kSent);
  }
  std::atomic<std::uint32_t> arrived{0};
  Reader<ses::CatalogueEntry> reader{beta_, topics::kCatalogue, [&](ses::CatalogueEntry&&) { ++arrived; }};
  EXPECT_TRUE(eventually([&] { return arrived == kObjects; })) << arrived;
  EXPECT_EQ(reader.counts().excess, 0u);
}

TEST_F(TwoPrograms, TheLargestSamplesArrive) {
  const std::string name(ses::kMaxName, 'n');
  auto roster = full_sample<ses::RosterEntry>(alpha_);
  roster.users.assign(ses::kMaxUsers, name);
  roster.served_users.assign(ses::kMaxUsers, {name, 1});
  roster.stops.assign(ses::kMaxStops, {1, 2, 3, 4, 5});
  auto demand = full_sample<ses::Demand>(alpha_);
  demand.have.clear();
  for (std::uint32_t i = 0; i < ses::kMaxHaveIntervals; ++i) demand.have.push_back({3 * i, 2});
  demand.wanted.assign(ses::kMaxWanted, {7, 8});
  demand.gaps.clear();
  for (std::uint32_t i = 0; i < ses::kMaxGaps; ++i) demand.gaps.push_back({2 * i, 1});
  auto metrics = full_sample<ses::Metrics>(alpha_);
  metrics.figures.assign(ses::kMaxFigures, {name, 1.5});
  metrics.meshes.assign(ses::kMaxMeshes, {~std::uint64_t{0}, ~std::uint64_t{0}});
  auto shown = full_sample<ses::ShownRegions>(alpha_);
  shown.regions.assign(ses::kMaxShownRegions, {7, 8});
  auto control = full_sample<ses::Control>(alpha_);
  control.text.assign(ses::kMaxText, 't');
  auto stop = full_sample<ses::EmergencyStop>(alpha_);
  stop.text.assign(ses::kMaxText, 't');
  auto reset = full_sample<ses::ForceReset>(alpha_);
  reset.stops.assign(ses::kMaxStops, {1, 2, 3});
  reset.text.assign(ses::kMaxText, 't');
  auto end = full_sample<ses::SessionEnd>(alpha_);
  end.text.assign(ses::kMaxText, 't');
  auto intent = full_sample<ses::Intent>(alpha_);
  intent.path.clear();
  for (std::size_t i = 0; i < ses::kMaxWaypoints; ++i)
    intent.path.push_back({static_cast<std::int64_t>(i), {{1, 2, 3}}});
  auto chunk = full_sample<ses::BulkChunk>(alpha_);
  chunk.pieces = {{1, 0, 1, 2, {}}};
  chunk.pieces[0].payload.assign(ses::kMaxPayload - ses::header_bytes(1, 1), 0xa5);

  const auto expect_arrival = [this](const auto& topic, const auto& sample) {
    using Sample = std::decay_t<decltype(sample)>;
    SCOPED_TRACE(topic.name);
    Inbox<Sample> inbox;
    Reader<Sample> reader{beta_, topic, inbox.callback()};
    Writer<Sample> writer{alpha_, topic};
    const auto received = send_until_received(writer, inbox, sample);
    ASSERT_TRUE(received.has_value()) << writer.invalid_reason();
    EXPECT_EQ(fields(*received), fields(sample));
  };
  expect_arrival(topics::kRoster, roster);
  expect_arrival(topics::kDemand, demand);
  expect_arrival(topics::kMetrics, metrics);
  expect_arrival(topics::kShownRegions, shown);
  expect_arrival(topics::kControl, control);
  expect_arrival(topics::kStop, stop);
  expect_arrival(topics::kReset, reset);
  expect_arrival(topics::kEnd, end);
  expect_arrival(topics::kIntent, intent);
  expect_arrival(topics::kRecords, chunk);
}

TEST_F(TwoPrograms, ChunksOfALongStreamArriveAtMostOnceAndInOrder) {
  constexpr std::uint32_t kChunks = 5000;
  Inbox<ses::BulkChunk> inbox;
  Reader<ses::BulkChunk> reader{beta_, topics::kRecords, inbox.callback(), {hrtc_partition("beta")}};
  Writer<ses::BulkChunk> writer{alpha_, topics::kRecords, {hrtc_partition("beta")}};
  ASSERT_TRUE(eventually([&] { return writer.matched() == 1 && reader.matched() == 1; }));

  auto chunk = full_sample<ses::BulkChunk>(alpha_);
  chunk.pieces = {{1, 0, 1, 2, {}}};
  chunk.pieces[0].payload.assign(ses::kMaxPayload - ses::header_bytes(1, 1), 1);
  for (std::uint32_t i = 1; i <= kChunks; ++i) {
    chunk.sequence = i;
    ASSERT_EQ(writer.send(chunk), SendStatus::kSent) << "chunk " << i;
  }

  std::uint32_t last = 0;
  while (last <= kChunks) {
    const auto received = inbox.next(100ms);
    if (!received) {  // the last chunks were lost
      chunk.sequence = kChunks + 1;
      ASSERT_EQ(writer.send(chunk), SendStatus::kSent);
      continue;
    }
    ASSERT_GT(received->sequence, last);
    last = received->sequence;
  }
}

TEST_F(TwoPrograms, AWriterWithoutAReaderNeverBlocks) {
  Writer<ses::BulkChunk> writer{alpha_, topics::kRecords};
  auto chunk = full_sample<ses::BulkChunk>(alpha_);
  for (std::uint32_t i = 1; i <= 10000; ++i) {
    chunk.sequence = i;
    ASSERT_EQ(writer.send(chunk), SendStatus::kSent) << "chunk " << i;
  }
}

TEST_F(TwoPrograms, ABlockedReaderDelaysNeitherTheSenderNorAnotherStream) {
  std::mutex blocking;
  std::unique_lock<std::mutex> block{blocking};
  Inbox<ses::BulkChunk> inbox;
  Reader<ses::BulkChunk> blocked{beta_,
                                 topics::kRecords,
                                 [&](ses::BulkChunk&&) { std::lock_guard<std::mutex> wait{blocking}; },
                                 {hrtc_partition("beta")}};
  Participants gamma{address(session_, "gamma")};
  Reader<ses::BulkChunk> healthy{gamma, topics::kRecords, inbox.callback(), {hrtc_partition("gamma")}};
  Writer<ses::BulkChunk> to_blocked{alpha_, topics::kRecords, {hrtc_partition("beta")}};
  Writer<ses::BulkChunk> to_healthy{alpha_, topics::kRecords, {hrtc_partition("gamma")}};
  ASSERT_TRUE(eventually([&] { return to_blocked.matched() == 1 && to_healthy.matched() == 1; }));

  auto chunk = full_sample<ses::BulkChunk>(alpha_);
  for (std::uint32_t i = 1; i <= 20000; ++i) {
    chunk.sequence = i;
    ASSERT_EQ(to_blocked.send(chunk), SendStatus::kSent) << "chunk " << i;
  }
  EXPECT_TRUE(send_until_received(to_healthy, inbox, chunk).has_value());
  block.unlock();
}

TEST_F(TwoPrograms, AWriterMayBeDestroyedWithChunksInFlight) {
  Inbox<ses::BulkChunk> inbox;
  Reader<ses::BulkChunk> reader{beta_, topics::kRecords, inbox.callback()};
  for (int round = 0; round < 30; ++round) {
    Writer<ses::BulkChunk> writer{alpha_, topics::kRecords};
    ASSERT_TRUE(eventually([&] { return writer.matched() == 1; }));
    auto chunk = full_sample<ses::BulkChunk>(alpha_);
    for (std::uint32_t i = 1; i <= 1000; ++i) {
      chunk.sequence = i;
      ASSERT_NE(writer.send(chunk), SendStatus::kInvalid);
    }
  }
}

TEST_F(TwoPrograms, ReadersOfAUserReceiveNoSamplesOfAnotherUser) {
  Inbox<ses::Intent> inbox_of_alice, inbox_of_bob;
  Reader<ses::Intent> reader_of_alice{beta_, topics::kIntent, inbox_of_alice.callback(), {user_partition("alice")}};
  Reader<ses::Intent> reader_of_bob{beta_, topics::kIntent, inbox_of_bob.callback(), {user_partition("bob")}};
  Writer<ses::Intent> to_alice{alpha_, topics::kIntent, {user_partition("alice")}};
  Writer<ses::Intent> to_bob{alpha_, topics::kIntent, {user_partition("bob")}};
  auto intent = full_sample<ses::Intent>(alpha_);

  intent.user_id = ses::id_of("alice");
  ASSERT_TRUE(send_until_received(to_alice, inbox_of_alice, intent).has_value());
  intent.user_id = ses::id_of("bob");
  const auto received = send_until_received(to_bob, inbox_of_bob, intent);

  ASSERT_TRUE(received.has_value());
  EXPECT_EQ(received->user_id, ses::id_of("bob"));
  EXPECT_TRUE(eventually([&] { return to_alice.matched() == 1 && to_bob.matched() == 1; }));
}

TEST_F(TwoPrograms, AProgramDoesNotReceiveItsOwnSamples) {
  Inbox<ses::ProbeState> inbox_of_alpha, inbox_of_beta;
  Reader<ses::ProbeState> at_alpha{alpha_, topics::kProbeState, inbox_of_alpha.callback()};
  Reader<ses::ProbeState> at_beta{beta_, topics::kProbeState, inbox_of_beta.callback()};
  Writer<ses::ProbeState> from_alpha{alpha_, topics::kProbeState};
  Writer<ses::ProbeState> from_beta{beta_, topics::kProbeState};

  ASSERT_TRUE(send_until_received(from_alpha, inbox_of_beta, full_sample<ses::ProbeState>(alpha_)).has_value());
  ASSERT_TRUE(send_until_received(from_beta, inbox_of_alpha, full_sample<ses::ProbeState>(beta_)).has_value());

  EXPECT_EQ(inbox_of_alpha.size(), 0u);
  EXPECT_TRUE(eventually([&] { return from_alpha.matched() == 1; }));
}

TEST_F(TwoPrograms, AStateArrivesAfterStatesOfMoreUsersThanTheHistoryHolds) {
  constexpr std::uint64_t kUsers = 1100;  // more instances than a history holds
  Inbox<ses::ProbeState> inbox;
  Reader<ses::ProbeState> reader{beta_, topics::kProbeState, inbox.callback()};
  Writer<ses::ProbeState> writer{alpha_, topics::kProbeState};
  auto state = full_sample<ses::ProbeState>(alpha_);
  ASSERT_TRUE(send_until_received(writer, inbox, state).has_value());
  for (state.user_id = 1; state.user_id <= kUsers; ++state.user_id)
    ASSERT_EQ(writer.send(state), SendStatus::kSent) << "user " << state.user_id;

  state.user_id = kUsers + 1;
  std::optional<ses::ProbeState> received;
  do {
    received = send_until_received(writer, inbox, state);
  } while (received && received->user_id != state.user_id);

  EXPECT_TRUE(received.has_value());
}

TEST_F(TwoPrograms, AnInvalidSampleIsNotSent) {
  Writer<ses::ProbeState> writer{alpha_, topics::kProbeState};
  auto state = full_sample<ses::ProbeState>(alpha_);
  state.force[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(writer.send(state), SendStatus::kInvalid);
  EXPECT_THAT(writer.invalid_reason(), testing::HasSubstr("force"));

  state = full_sample<ses::ProbeState>(beta_);
  EXPECT_EQ(writer.send(state), SendStatus::kInvalid);
  EXPECT_THAT(writer.invalid_reason(), testing::HasSubstr("origin"));
}

TEST_F(TwoPrograms, AReaderMayBeDestroyedWhileSamplesArrive) {
  Writer<ses::ProbeState> writer{alpha_, topics::kProbeState};
  for (int round = 0; round < 10; ++round) {
    Inbox<ses::ProbeState> inbox;
    std::atomic<bool> destroyed{false}, called_after_destruction{false};
    {
      Reader<ses::ProbeState> reader{beta_, topics::kProbeState, [&](ses::ProbeState&& state) {
                                       if (destroyed) called_after_destruction = true;
                                       inbox.callback()(std::move(state));
                                     }};
      ASSERT_TRUE(send_until_received(writer, inbox, full_sample<ses::ProbeState>(alpha_)).has_value());
      for (int i = 0; i < 50; ++i) ASSERT_NE(writer.send(full_sample<ses::ProbeState>(alpha_)), SendStatus::kInvalid);
    }
    destroyed = true;
    for (int i = 0; i < 50; ++i) ASSERT_NE(writer.send(full_sample<ses::ProbeState>(alpha_)), SendStatus::kInvalid);
    EXPECT_FALSE(called_after_destruction);
  }
}

TEST(TwoSessions, OnOneDomainReceiveOnlyTheirOwnSamples) {
  const std::string session_1 = unique_session("1"), session_2 = unique_session("2");
  Participants alpha_1{address(session_1, "alpha")}, beta_1{address(session_1, "beta")};
  Participants alpha_2{address(session_2, "alpha")}, beta_2{address(session_2, "beta")};
  Inbox<ses::RosterEntry> inbox_1, inbox_2;
  Reader<ses::RosterEntry> reader_1{beta_1, topics::kRoster, inbox_1.callback()};
  Reader<ses::RosterEntry> reader_2{beta_2, topics::kRoster, inbox_2.callback()};
  Writer<ses::RosterEntry> writer_1{alpha_1, topics::kRoster};
  Writer<ses::RosterEntry> writer_2{alpha_2, topics::kRoster};

  // Both pairs exchange several rounds at the same time.
  for (int i = 0; i < 5; ++i) {
    const auto received_1 = send_until_received(writer_1, inbox_1, full_sample<ses::RosterEntry>(alpha_1));
    const auto received_2 = send_until_received(writer_2, inbox_2, full_sample<ses::RosterEntry>(alpha_2));
    ASSERT_TRUE(received_1.has_value() && received_2.has_value());
    ASSERT_EQ(received_1->session, session_1);
    ASSERT_EQ(received_2->session, session_2);
  }
  EXPECT_TRUE(eventually([&] {
    return writer_1.matched() == 1 && writer_2.matched() == 1 && reader_1.matched() == 1 && reader_2.matched() == 1;
  }));
}

TEST(SharedMemory, IsNotUsed) {
  const auto mapped_files = [] {  // of this program only, because other programs may use shared memory
    std::ifstream maps{"/proc/self/maps"};
    return std::string{std::istreambuf_iterator<char>{maps}, {}};
  };
  const std::string name = unique_session("shm");
  Participants alpha{address(name, "alpha")}, beta{address(name, "beta")};
  Inbox<ses::Metrics> inbox;
  Reader<ses::Metrics> reader{beta, topics::kMetrics, inbox.callback()};
  Writer<ses::Metrics> writer{alpha, topics::kMetrics};
  ASSERT_TRUE(send_until_received(writer, inbox, full_sample<ses::Metrics>(alpha)).has_value());
  EXPECT_THAT(mapped_files(), testing::Not(testing::HasSubstr("/dev/shm/")));
}

}  // namespace
}  // namespace tactus::wire::test
