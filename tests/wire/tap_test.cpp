#include "wire/tap.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support.hpp"

namespace tactus::wire::test {
namespace {

class TapTest : public ::testing::Test {
 protected:
  /// Sends samples until the tap has received one of this topic, and returns its bytes.
  template <class Sample>
  std::vector<std::uint8_t> receive(const TopicSpec<Sample>& topic, const EndpointOptions& options = {}) {
    SCOPED_TRACE(topic.name);
    Writer<Sample> writer{alpha_, topic, options};
    const Sample sample = full_sample<Sample>(alpha_);
    const auto end = std::chrono::steady_clock::now() + kWatchdog;
    for (std::optional<Received> received; std::chrono::steady_clock::now() < end;) {
      EXPECT_EQ(writer.send(sample), SendStatus::kSent) << writer.invalid_reason();
      while ((received = inbox_.next(10ms)))
        if (tap_.topics()[received->topic].name == topic.name) return received->bytes;
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
  Inbox<Received> inbox_;
  Tap tap_{beta_, true, [this](std::size_t topic, std::span<const std::uint8_t> bytes) {
             inbox_.callback()(Received{topic, {bytes.begin(), bytes.end()}});
           }};
};

TEST_F(TapTest, ReceivesEveryTopicInEveryPartition) {
  const std::string name = alpha_.address().participant;
  for (const std::vector<std::uint8_t>& bytes : {receive(topics::kRoster),
                                                 receive(topics::kCatalogue),
                                                 receive(topics::kDemand),
                                                 receive(topics::kMetrics),
                                                 receive(topics::kControl),
                                                 receive(topics::kReset),
                                                 receive(topics::kEnd),
                                                 receive(topics::kStop),
                                                 receive(topics::kBase, {hrtc_partition("desk")}),
                                                 receive(topics::kRecords, {hrtc_partition("desk")}),
                                                 receive(topics::kProbeState),
                                                 receive(topics::kProbeStateFullRate, {group_partition(7)}),
                                                 receive(topics::kDevicePose, {user_partition("ann")}),
                                                 receive(topics::kDeviceCommand, {user_partition("ann")}),
                                                 receive(topics::kIntent, {user_partition("ann")}),
                                                 receive(topics::kObjectPose),
                                                 receive(topics::kObjectClaim),
                                                 receive(topics::kObjectGrant),
                                                 receive(topics::kObjectCopy, {group_partition(7)}),
                                                 receive(topics::kClock),
                                                 receive(topics::kClock, {hrtc_partition("desk")})}) {
    ASSERT_GT(bytes.size(), 4u);
    EXPECT_THAT(std::vector<std::uint8_t>(bytes.begin(), bytes.begin() + 4), testing::ElementsAre(0, 1, 0, 0))
        << "CDR, little-endian";
  }
}

TEST_F(TapTest, ReportsATypeOfTheIdlForEachTopic) {
  for (const TapTopic& topic : tap_.topics()) {
    const std::string type = topic.type.substr(topic.type.rfind(':') + 1);
    EXPECT_THAT(idl_text(), testing::HasSubstr("struct " + type + " {")) << topic.name;
  }
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
