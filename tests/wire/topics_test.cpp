#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <string>

#include "support.hpp"

namespace tactus::wire::test {
namespace {

/// A host and an HRTC of one session, each with sockets of its own, in one process.
class TwoPrograms : public testing::Test {
 protected:
  const std::string session_ = unique_session("two");
  Participants alpha_{address(session_, "alpha")};
  Participants beta_{address(session_, "beta")};

  template <class Sample>
  void expect_round_trip(const TopicSpec<Sample>& topic, const EndpointOptions& options = {}) {
    SCOPED_TRACE(topic.name);
    Inbox<Sample> inbox;
    Reader<Sample> reader{beta_, topic, inbox.callback(), options};
    Writer<Sample> writer{alpha_, topic, options};
    const Sample sent = full<Sample>(alpha_);

    const auto got = send_until_received(writer, inbox, sent);

    ASSERT_TRUE(got.has_value()) << "last invalid sample: " << writer.invalid_reason() << reader.invalid_reason();
    EXPECT_EQ(fields(*got), fields(sent));
    EXPECT_EQ(reader.counts().invalid, 0u) << reader.invalid_reason();
    // A sample may arrive before either endpoint is notified of the match.
    EXPECT_TRUE(eventually([&] { return writer.matched() == 1 && reader.matched() == 1; }));
  }

  template <class Sample>
  void expect_late_joiner_gets(const TopicSpec<Sample>& topic) {
    SCOPED_TRACE(topic.name);
    Writer<Sample> writer{alpha_, topic};
    const Sample sent = full<Sample>(alpha_);
    ASSERT_EQ(writer.send(sent), SendStatus::kSent);

    Inbox<Sample> inbox;
    Reader<Sample> reader{beta_, topic, inbox.callback()};

    const auto got = inbox.next();
    ASSERT_TRUE(got.has_value());
    EXPECT_EQ(fields(*got), fields(sent));
  }
};

TEST_F(TwoPrograms, EveryFieldOfEveryTopicArrives) {
  expect_round_trip(topics::kRoster);
  expect_round_trip(topics::kCatalogue);
  expect_round_trip(topics::kDemand);
  expect_round_trip(topics::kMetrics);
  expect_round_trip(topics::kControl);
  expect_round_trip(topics::kReset);
  expect_round_trip(topics::kEnd);
  expect_round_trip(topics::kStop);
  expect_round_trip(topics::kBase, {hrtc_partition("beta")});
  expect_round_trip(topics::kRecords, {hrtc_partition("beta")});
  expect_round_trip(topics::kProbeState);
  expect_round_trip(topics::kDevicePose, {user_partition("alice")});
  expect_round_trip(topics::kDeviceCommand, {user_partition("alice")});
  expect_round_trip(topics::kIntent, {user_partition("alice")});
  expect_round_trip(topics::kObjectPose);
  expect_round_trip(topics::kObjectClaim);
  expect_round_trip(topics::kObjectGrant);
  expect_round_trip(topics::kObjectCopy);
  expect_round_trip(topics::kClock);
}

TEST_F(TwoPrograms, ALateJoinerGetsTransientLocalTopics) {
  expect_late_joiner_gets(topics::kCatalogue);
  expect_late_joiner_gets(topics::kControl);
  expect_late_joiner_gets(topics::kEnd);
}

TEST_F(TwoPrograms, ALateJoinerGetsTheNewestOfEachObject) {
  Writer<ses::CatalogueEntry> writer{alpha_, topics::kCatalogue};
  auto entry = full<ses::CatalogueEntry>(alpha_);
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

  std::vector<std::pair<std::string, std::uint32_t>> got;
  for (int i = 0; i < 3; ++i) {
    const auto d = inbox.next();
    ASSERT_TRUE(d.has_value()) << "after " << i;
    got.emplace_back(d->object, d->base_bytes);
  }
  EXPECT_THAT(got,
              testing::UnorderedElementsAre(testing::Pair("a", 2u), testing::Pair("b", 2u), testing::Pair("c", 2u)));
}

TEST_F(TwoPrograms, TheLargestSamplesArrive) {
  const std::string name(ses::kMaxName, 'n');
  auto roster = full<ses::RosterEntry>(alpha_);
  roster.users.assign(ses::kMaxSlots, name);
  roster.slots.assign(ses::kMaxSlots, {name, 1});
  roster.stops.assign(ses::kMaxStops, {1, 2, 3, 4, 5});
  auto demand = full<ses::Demand>(alpha_);
  demand.have.clear();
  for (std::uint32_t i = 0; i < ses::kMaxHaveIntervals; ++i) demand.have.push_back({3 * i, 2});
  demand.wanted.assign(ses::kMaxWanted, {7, 8});
  demand.gaps.clear();
  for (std::uint32_t i = 0; i < ses::kMaxGaps; ++i) demand.gaps.push_back({2 * i, 1});
  auto metrics = full<ses::Metrics>(alpha_);
  metrics.figures.assign(ses::kMaxFigures, {name, 1.5});
  metrics.meshes.assign(ses::kMaxMeshes, {~std::uint64_t{0}, ~std::uint64_t{0}});
  auto control = full<ses::Control>(alpha_);
  control.text.assign(ses::kMaxText, 't');
  auto stop = full<ses::EmergencyStop>(alpha_);
  stop.text.assign(ses::kMaxText, 't');
  auto reset = full<ses::ForceReset>(alpha_);
  reset.stops.assign(ses::kMaxStops, {1, 2, 3});
  reset.text.assign(ses::kMaxText, 't');
  auto end = full<ses::SessionEnd>(alpha_);
  end.text.assign(ses::kMaxText, 't');
  auto intent = full<ses::Intent>(alpha_);
  intent.path.clear();
  for (std::size_t i = 0; i < ses::kMaxWaypoints; ++i)
    intent.path.push_back({static_cast<std::int64_t>(i), {{1, 2, 3}}});
  auto chunk = full<ses::BulkChunk>(alpha_);
  chunk.pieces = {{1, 0, 1, 2, {}}};
  chunk.pieces[0].payload.assign(ses::kMaxPayload - ses::header_bytes(1, 1), 0xa5);

  const auto arrives = [this](const auto& topic, const auto& sample) {
    using Sample = std::decay_t<decltype(sample)>;
    SCOPED_TRACE(topic.name);
    Inbox<Sample> inbox;
    Reader<Sample> reader{beta_, topic, inbox.callback()};
    Writer<Sample> writer{alpha_, topic};
    const auto got = send_until_received(writer, inbox, sample);
    ASSERT_TRUE(got.has_value()) << writer.invalid_reason();
    EXPECT_EQ(fields(*got), fields(sample));
  };
  arrives(topics::kRoster, roster);
  arrives(topics::kDemand, demand);
  arrives(topics::kMetrics, metrics);
  arrives(topics::kControl, control);
  arrives(topics::kStop, stop);
  arrives(topics::kReset, reset);
  arrives(topics::kEnd, end);
  arrives(topics::kIntent, intent);
  arrives(topics::kRecords, chunk);
}

TEST_F(TwoPrograms, ChunksOfALongStreamArriveAtMostOnceAndInOrder) {
  constexpr std::uint32_t kChunks = 5000;
  Inbox<ses::BulkChunk> inbox;
  Reader<ses::BulkChunk> reader{beta_, topics::kRecords, inbox.callback(), {hrtc_partition("beta")}};
  Writer<ses::BulkChunk> writer{alpha_, topics::kRecords, {hrtc_partition("beta")}};
  ASSERT_TRUE(eventually([&] { return writer.matched() == 1 && reader.matched() == 1; }));

  auto chunk = full<ses::BulkChunk>(alpha_);
  chunk.pieces = {{1, 0, 1, 2, {}}};
  chunk.pieces[0].payload.assign(ses::kMaxPayload - ses::header_bytes(1, 1), 1);
  for (std::uint32_t i = 1; i <= kChunks; ++i) {
    chunk.sequence = i;
    ASSERT_EQ(writer.send(chunk), SendStatus::kSent) << "chunk " << i;
  }

  std::uint32_t last = 0;
  while (last <= kChunks) {
    const auto got = inbox.next(100ms);
    if (!got) {  // the last chunks were lost
      chunk.sequence = kChunks + 1;
      ASSERT_EQ(writer.send(chunk), SendStatus::kSent);
      continue;
    }
    ASSERT_GT(got->sequence, last);
    last = got->sequence;
  }
}

TEST_F(TwoPrograms, AWriterWithoutAReaderNeverBlocks) {
  Writer<ses::BulkChunk> writer{alpha_, topics::kRecords};
  auto chunk = full<ses::BulkChunk>(alpha_);
  for (std::uint32_t i = 1; i <= 10000; ++i) {
    chunk.sequence = i;
    ASSERT_EQ(writer.send(chunk), SendStatus::kSent) << "chunk " << i;
  }
}

TEST_F(TwoPrograms, AStuckReaderDelaysNeitherTheSenderNorAnotherStream) {
  std::mutex stuck;
  std::unique_lock<std::mutex> hold{stuck};
  Inbox<ses::BulkChunk> inbox;
  Reader<ses::BulkChunk> frozen{beta_,
                                topics::kRecords,
                                [&](ses::BulkChunk&&) { std::lock_guard<std::mutex> wait{stuck}; },
                                {hrtc_partition("beta")}};
  Participants gamma{address(session_, "gamma")};
  Reader<ses::BulkChunk> healthy{gamma, topics::kRecords, inbox.callback(), {hrtc_partition("gamma")}};
  Writer<ses::BulkChunk> to_frozen{alpha_, topics::kRecords, {hrtc_partition("beta")}};
  Writer<ses::BulkChunk> to_healthy{alpha_, topics::kRecords, {hrtc_partition("gamma")}};
  ASSERT_TRUE(eventually([&] { return to_frozen.matched() == 1 && to_healthy.matched() == 1; }));

  auto chunk = full<ses::BulkChunk>(alpha_);
  for (std::uint32_t i = 1; i <= 20000; ++i) {
    chunk.sequence = i;
    ASSERT_EQ(to_frozen.send(chunk), SendStatus::kSent) << "chunk " << i;
  }
  EXPECT_TRUE(send_until_received(to_healthy, inbox, chunk).has_value());
  hold.unlock();
}

TEST_F(TwoPrograms, AWriterMayLeaveWithChunksInFlight) {
  Inbox<ses::BulkChunk> inbox;
  Reader<ses::BulkChunk> reader{beta_, topics::kRecords, inbox.callback()};
  for (int round = 0; round < 30; ++round) {
    Writer<ses::BulkChunk> writer{alpha_, topics::kRecords};
    ASSERT_TRUE(eventually([&] { return writer.matched() == 1; }));
    auto chunk = full<ses::BulkChunk>(alpha_);
    for (std::uint32_t i = 1; i <= 1000; ++i) {
      chunk.sequence = i;
      ASSERT_NE(writer.send(chunk), SendStatus::kInvalid);
    }
  }
}

TEST_F(TwoPrograms, SamplesOfAUserStayInItsPartition) {
  Inbox<ses::Intent> alices, bobs;
  Reader<ses::Intent> alice{beta_, topics::kIntent, alices.callback(), {user_partition("alice")}};
  Reader<ses::Intent> bob{beta_, topics::kIntent, bobs.callback(), {user_partition("bob")}};
  Writer<ses::Intent> to_alice{alpha_, topics::kIntent, {user_partition("alice")}};
  Writer<ses::Intent> to_bob{alpha_, topics::kIntent, {user_partition("bob")}};
  auto intent = full<ses::Intent>(alpha_);

  intent.user_id = ses::id_of("alice");
  ASSERT_TRUE(send_until_received(to_alice, alices, intent).has_value());
  intent.user_id = ses::id_of("bob");
  const auto got = send_until_received(to_bob, bobs, intent);

  ASSERT_TRUE(got.has_value());
  EXPECT_EQ(got->user_id, ses::id_of("bob"));
  EXPECT_TRUE(eventually([&] { return to_alice.matched() == 1 && to_bob.matched() == 1; }));
}

TEST_F(TwoPrograms, AProgramDoesNotReceiveItsOwnSamples) {
  Inbox<ses::ProbeState> own, others;
  Reader<ses::ProbeState> at_alpha{alpha_, topics::kProbeState, own.callback()};
  Reader<ses::ProbeState> at_beta{beta_, topics::kProbeState, others.callback()};
  Writer<ses::ProbeState> writer{alpha_, topics::kProbeState};
  Writer<ses::ProbeState> from_beta{beta_, topics::kProbeState};

  ASSERT_TRUE(send_until_received(writer, others, full<ses::ProbeState>(alpha_)).has_value());
  ASSERT_TRUE(send_until_received(from_beta, own, full<ses::ProbeState>(beta_)).has_value());

  EXPECT_EQ(own.size(), 0u);
  EXPECT_TRUE(eventually([&] { return writer.matched() == 1; }));
}

TEST_F(TwoPrograms, AUserArrivesAfterMoreUsersThanTheHistoryHolds) {
  constexpr std::uint64_t kUsers = 1100;  // more instances than a history holds
  Inbox<ses::ProbeState> inbox;
  Reader<ses::ProbeState> reader{beta_, topics::kProbeState, inbox.callback()};
  Writer<ses::ProbeState> writer{alpha_, topics::kProbeState};
  auto state = full<ses::ProbeState>(alpha_);
  ASSERT_TRUE(send_until_received(writer, inbox, state).has_value());
  for (state.user_id = 1; state.user_id <= kUsers; ++state.user_id)
    ASSERT_EQ(writer.send(state), SendStatus::kSent) << "user " << state.user_id;

  state.user_id = kUsers + 1;
  std::optional<ses::ProbeState> got;
  do {
    got = send_until_received(writer, inbox, state);
  } while (got && got->user_id != state.user_id);

  EXPECT_TRUE(got.has_value());
}

TEST_F(TwoPrograms, AnInvalidSampleIsNotSent) {
  Writer<ses::ProbeState> writer{alpha_, topics::kProbeState};
  auto state = full<ses::ProbeState>(alpha_);
  state.force[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(writer.send(state), SendStatus::kInvalid);
  EXPECT_THAT(writer.invalid_reason(), testing::HasSubstr("force"));

  state = full<ses::ProbeState>(beta_);
  EXPECT_EQ(writer.send(state), SendStatus::kInvalid);
  EXPECT_THAT(writer.invalid_reason(), testing::HasSubstr("origin"));
}

TEST_F(TwoPrograms, AReaderMayLeaveWhileSamplesArrive) {
  Writer<ses::ProbeState> writer{alpha_, topics::kProbeState};
  for (int round = 0; round < 10; ++round) {
    Inbox<ses::ProbeState> inbox;
    std::atomic<bool> gone{false}, called_late{false};
    {
      Reader<ses::ProbeState> reader{beta_, topics::kProbeState, [&](ses::ProbeState&& p) {
                                       if (gone) called_late = true;
                                       inbox.callback()(std::move(p));
                                     }};
      ASSERT_TRUE(send_until_received(writer, inbox, full<ses::ProbeState>(alpha_)).has_value());
      for (int i = 0; i < 50; ++i) ASSERT_NE(writer.send(full<ses::ProbeState>(alpha_)), SendStatus::kInvalid);
    }
    gone = true;
    for (int i = 0; i < 50; ++i) ASSERT_NE(writer.send(full<ses::ProbeState>(alpha_)), SendStatus::kInvalid);
    EXPECT_FALSE(called_late);
  }
}

TEST(TwoSessions, OnOneDomainDoNotMatch) {
  const std::string one = unique_session("one"), other = unique_session("other");
  Participants a{address(one, "a")}, b{address(one, "b")};
  Participants x{address(other, "a")}, y{address(other, "b")};
  Inbox<ses::RosterEntry> at_b, at_y;
  Reader<ses::RosterEntry> reader_b{b, topics::kRoster, at_b.callback()};
  Reader<ses::RosterEntry> reader_y{y, topics::kRoster, at_y.callback()};
  Writer<ses::RosterEntry> writer_a{a, topics::kRoster};
  Writer<ses::RosterEntry> writer_x{x, topics::kRoster};

  // Both pairs exchange several rounds at the same time.
  for (int i = 0; i < 5; ++i) {
    const auto got_b = send_until_received(writer_a, at_b, full<ses::RosterEntry>(a));
    const auto got_y = send_until_received(writer_x, at_y, full<ses::RosterEntry>(x));
    ASSERT_TRUE(got_b.has_value() && got_y.has_value());
    ASSERT_EQ(got_b->session, one);
    ASSERT_EQ(got_y->session, other);
  }
  EXPECT_TRUE(eventually([&] {
    return writer_a.matched() == 1 && writer_x.matched() == 1 && reader_b.matched() == 1 && reader_y.matched() == 1;
  }));
}

TEST(SharedMemory, IsNotUsed) {
  const auto mapped = [] {  // by this program; others may use it
    std::ifstream maps{"/proc/self/maps"};
    return std::string{std::istreambuf_iterator<char>{maps}, {}};
  };
  const std::string name = unique_session("shm");
  Participants a{address(name, "a")}, b{address(name, "b")};
  Inbox<ses::Metrics> inbox;
  Reader<ses::Metrics> reader{b, topics::kMetrics, inbox.callback()};
  Writer<ses::Metrics> writer{a, topics::kMetrics};
  ASSERT_TRUE(send_until_received(writer, inbox, full<ses::Metrics>(a)).has_value());
  EXPECT_THAT(mapped(), testing::Not(testing::HasSubstr("/dev/shm/")));
}

}  // namespace
}  // namespace tactus::wire::test
