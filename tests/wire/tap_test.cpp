#include "wire/tap.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "support.hpp"

namespace tactus::wire::test {
namespace {

class TapTest : public ::testing::Test {
 protected:
  /// Sends samples until the tap has received one of them, and returns its bytes.
  template <class Sample>
  std::vector<std::uint8_t> receive(const TopicSpec<Sample>& topic, const EndpointOptions& options = {}) {
    SCOPED_TRACE(topic.profile + (" in partition '" + options.partition + "'"));
    Writer<Sample> writer{alpha_, topic, options};
    Sample sample = full_sample<Sample>(alpha_);
    std::vector<std::uint8_t> mark;  // bytes that no earlier sample of the topic has
    if constexpr (requires { sample.origin; }) {
      sample.origin.time_ns = 0x1122334455660000 + ++samples_;
      mark.resize(sizeof sample.origin.time_ns);
      std::memcpy(mark.data(), &sample.origin.time_ns, mark.size());
    }
    const auto end = std::chrono::steady_clock::now() + kWatchdog;
    for (std::optional<Received> received; std::chrono::steady_clock::now() < end;) {
      EXPECT_EQ(writer.send(sample), SendStatus::kSent) << writer.invalid_reason();
      while ((received = inbox_.next(10ms)))
        if (tap_.topics()[received->topic].name == topic.name &&
            std::search(received->bytes.begin(), received->bytes.end(), mark.begin(), mark.end()) !=
                received->bytes.end())
          return received->bytes;
    }
    ADD_FAILURE() << "no sample of " << topic.name;
    return {};
  }

  struct Received {
    std::size_t topic;
    std::vector<std::uint8_t> bytes;
  };
  Participants alpha_{address(unique_session("tap"), "alpha")};
  Participants beta_{address(alpha_.address().session, "beta")};
  std::int64_t samples_ = 0;
  Inbox<Received> inbox_;
  Tap tap_{beta_, [](const std::string&, TrafficClass) { return true; },
           [this](std::size_t topic, std::span<const std::uint8_t> bytes) {
             inbox_.callback()(Received{topic, {bytes.begin(), bytes.end()}});
           }};
};

TEST_F(TapTest, ReceivesEveryTopicInEveryPartition) {
  topics::for_each([&](const auto& topic) {
    for (const EndpointOptions& options : partitions_of(topic)) {
      const std::vector<std::uint8_t> bytes = receive(topic, options);
      ASSERT_GT(bytes.size(), 4u);
      EXPECT_THAT(std::vector<std::uint8_t>(bytes.begin(), bytes.begin() + 4), testing::ElementsAre(0, 1, 0, 0))
          << "CDR, little-endian";
    }
  });
}

TEST_F(TapTest, ReportsATypeOfTheIdlForEachTopic) {
  for (const TapTopic& topic : tap_.topics()) {
    const std::string type = topic.type.substr(topic.type.rfind(':') + 1);
    EXPECT_THAT(idl_text(), testing::HasSubstr("struct " + type + " {")) << topic.name;
  }
}

TEST_F(TapTest, CountsTheSamplesAboveTheRateOfTheirTopic) {
  (void)receive(topics::kProbeState);
  EXPECT_EQ(tap_.excess(), 0u);
  Writer<ses::EmergencyStop> writer{alpha_, topics::kStop};
  const auto stop = full_sample<ses::EmergencyStop>(alpha_);
  EXPECT_TRUE(eventually([&] { return writer.send(stop) == SendStatus::kSent && tap_.excess() > 0; }));
}

TEST_F(TapTest, LeavesLargeChunksToTheirReader) {
  Participants gamma{address(alpha_.address().session, "gamma")};
  Inbox<ses::BulkChunk> inbox;
  Reader<ses::BulkChunk> reader{gamma, topics::kRecords, inbox.callback(), {hrtc_partition("gamma")}};
  Writer<ses::BulkChunk> writer{alpha_, topics::kRecords, {hrtc_partition("gamma")}};
  ASSERT_TRUE(eventually([&] { return writer.matched() == 2; }));
  auto chunk = full_sample<ses::BulkChunk>(alpha_);
  chunk.pieces = {{1, 0, 1, 2, {}}};
  chunk.pieces[0].payload.assign(ses::kMaxPayload - ses::header_bytes(1, 1), 0xa5);
  const auto received = send_until_received(writer, inbox, chunk);
  ASSERT_TRUE(received.has_value());
  EXPECT_EQ(fields(*received), fields(chunk));
}

}  // namespace
}  // namespace tactus::wire::test
