/// Messages that a program without keys, or a member with changed software, sends into a secured session. They name
/// another member as their sender.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <net/ethernet.h>
#include <net/if.h>
#include <netpacket/packet.h>
#include <sys/socket.h>

#include <algorithm>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "rtps_bytes.hpp"
#include "support.hpp"
#include "tests/wire/encoding.hpp"
#include "tests/wire/secured_session.hpp"
#include "wire/dds.hpp"
#include "wire/footprint.hpp"
#include "wire/rate_limit.hpp"
#include "wire/tap.hpp"
#include "wire/transport/protection.hpp"
#include "wire/transport/rtps_message.hpp"

namespace tactus::wire::test {
namespace {

using testing::AnyOf;

/// Sends datagrams to all ports of a domain at which a participant of this machine may receive samples.
class Injector {
 public:
  explicit Injector(int domain) : domain_{domain} {}
  ~Injector() { ::close(socket_); }
  Injector(const Injector&) = delete;
  Injector& operator=(const Injector&) = delete;

  void send(const Bytes& message) const {
    constexpr int kParticipants = 40;
    for (int id = 0; id < kParticipants; ++id) {
      for (const int kind : {10, 11}) {  // discovery and samples
        sockaddr_in to{};
        to.sin_family = AF_INET;
        to.sin_port = htons(static_cast<std::uint16_t>(7400 + 250 * domain_ + kind + 2 * id));
        to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        (void)::sendto(socket_, message.data(), message.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
      }
    }
  }

 private:
  int domain_;
  int socket_ = ::socket(AF_INET, SOCK_DGRAM, 0);
};

/// The payload of a submessage ends at a multiple of four bytes.
Bytes padded(Bytes bytes) {
  bytes.resize((bytes.size() + 3) / 4 * 4);
  return bytes;
}

/// Captures all packets of the loopback interface.
class Capture {
 public:
  Capture() : socket_{::socket(AF_PACKET, SOCK_DGRAM | SOCK_NONBLOCK, htons(ETH_P_IP))} {
    sockaddr_ll loopback{};
    loopback.sll_family = AF_PACKET;
    loopback.sll_protocol = htons(ETH_P_IP);
    loopback.sll_ifindex = static_cast<int>(::if_nametoindex("lo"));
    constexpr int kBuffer = 64 << 20;
    if (is_permitted() && (::setsockopt(socket_, SOL_SOCKET, SO_RCVBUFFORCE, &kBuffer, sizeof kBuffer) != 0 ||
                           ::bind(socket_, reinterpret_cast<const sockaddr*>(&loopback), sizeof loopback) != 0))
      ADD_FAILURE() << "cannot capture";
  }
  ~Capture() { ::close(socket_); }
  Capture(const Capture&) = delete;
  Capture& operator=(const Capture&) = delete;
  /// False for a user without CAP_NET_RAW: then there is nothing to capture, and the test is skipped.
  [[nodiscard]] bool is_permitted() const noexcept { return socket_ >= 0; }

  /// Returns the messages of RTPS to the ports of a session, or to those of discovery, since the last call.
  [[nodiscard]] std::vector<Bytes> messages(int domain, bool only_discovery = false) {
    constexpr std::size_t kUdpHeader = 8, kMaxPacket = 65536;
    std::vector<Bytes> all;
    Bytes packet(kMaxPacket);
    for (ssize_t size; (size = ::recv(socket_, packet.data(), packet.size(), 0)) > 0;) {
      const std::size_t ip_header = (packet[0] & 0xfu) * 4;
      if (packet[9] != IPPROTO_UDP || static_cast<std::size_t>(size) < ip_header + kUdpHeader) continue;
      const int port = packet[ip_header + 2] << 8 | packet[ip_header + 3];
      if (port < 7400 + 250 * domain || port >= 7400 + 250 * (domain + kTrafficClasses)) continue;
      if (only_discovery && !is_discovery_port(static_cast<std::uint32_t>(port))) continue;
      all.emplace_back(packet.begin() + static_cast<std::ptrdiff_t>(ip_header + kUdpHeader), packet.begin() + size);
    }
    return all;
  }

 private:
  int socket_;
};

bool contains(const Bytes& message, const std::string& text) {
  return std::search(message.begin(), message.end(), text.begin(), text.end()) != message.end();
}

/// Writes any bytes to a topic without a key, as a member with changed software.
template <class Sample>
class BytesWriter {
 public:
  BytesWriter(Participants& from, const TopicSpec<Sample>& topic)
      : participant_{from.impl().participant(topic.traffic)} {
    const dds::TypeSupport imitated{new typename IdlOf<Sample>::Support};
    dds::Topic& made = from.impl().topic(topic.name, topic.traffic,
                                         dds::TypeSupport{new EncodedType{imitated.get_type_name().c_str()}});
    dds::PublisherQos qos = dds::PUBLISHER_QOS_DEFAULT;
    qos.partition().push_back(from.address().session.c_str());
    publisher_ = participant_.create_publisher(qos);
    writer_ = publisher_->create_datawriter(&made, from.impl().writer_qos.at(topic.profile));
  }
  ~BytesWriter() {
    publisher_->delete_datawriter(writer_);
    participant_.delete_publisher(publisher_);
  }
  BytesWriter(const BytesWriter&) = delete;
  BytesWriter& operator=(const BytesWriter&) = delete;
  [[nodiscard]] bool send(Bytes bytes) { return succeeded(writer_->write(&bytes)); }

 private:
  dds::DomainParticipant& participant_;
  dds::Publisher* publisher_ = nullptr;
  dds::DataWriter* writer_ = nullptr;
};

class ForgedTest : public SecuredSession {
 protected:
  /// A tap of the topic stop, in `desk`.
  [[nodiscard]] Tap tap_of_stops(Tap::OnSample on_sample) {
    return {desk_, [](const std::string& topic, TrafficClass) { return topic == topics::kStop.name; },
            std::move(on_sample)};
  }
  /// The encoding of a stop of `museum`.
  [[nodiscard]] Bytes encoded_stop(std::uint32_t number) {
    auto stop = full_sample<ses::EmergencyStop>(museum_);
    stop.number = number;
    return padded(encoded(stop));
  }
  /// The begin of that encoding.
  [[nodiscard]] Bytes truncated_stop() {
    Bytes bytes = encoded_stop(1);
    bytes.resize(12);
    return bytes;
  }
};

TEST_F(ForgedTest, APlainSampleInTheNameOfAMemberIsRefused) {
  Inbox<ses::EmergencyStop> inbox;
  Reader<ses::EmergencyStop> reader{desk_, topics::kStop, inbox.callback()};
  Writer<ses::EmergencyStop> writer{museum_, topics::kStop};
  ASSERT_TRUE(send_until_received(writer, inbox, full_sample<ses::EmergencyStop>(museum_)));

  auto forged = full_sample<ses::EmergencyStop>(museum_);
  forged.text = "forged";
  const Injector injector{desk_.address().domain + 1};
  for (std::uint32_t entity = 0; entity < 32; ++entity) {
    for (const unsigned char kind : {'\x02', '\x03'}) {  // writers with and without key
      const Bytes sample = data({0, 0, static_cast<std::uint8_t>(entity), kind}, 1'000'000, padded(encoded(forged)));
      injector.send(message_of({sample}, prefix_of(museum_.impl().participant(TrafficClass::kProbe).guid())));
    }
  }
  while (const auto sample = inbox.next(500ms)) EXPECT_NE(sample->text, "forged");
  EXPECT_TRUE(is_in_audit_log(R"("event":"plain message","from":"127.0.0.1")"));
}

constexpr std::size_t kCapturedStops = 20;

/// Sends kCapturedStops stops, or more, with this text from one participant to another, and returns all messages of
/// both.
std::vector<Bytes> captured_stops(Capture& capture, Participants& from, Participants& to, const std::string& text) {
  Inbox<ses::EmergencyStop> inbox;
  Reader<ses::EmergencyStop> reader{to, topics::kStop, inbox.callback()};
  Writer<ses::EmergencyStop> writer{from, topics::kStop};
  auto stop = full_sample<ses::EmergencyStop>(from);
  stop.text = text;
  EXPECT_TRUE(send_until_received(writer, inbox, stop));
  for (std::size_t i = 1; i < kCapturedStops; ++i) EXPECT_EQ(writer.send(stop), SendStatus::kSent);
  return capture.messages(from.address().domain);
}

TEST(CaptureTest, ShowsTheSamplesOfASessionWithoutKeys) {
  Capture capture;
  if (!capture.is_permitted()) GTEST_SKIP() << "needs the right to capture packets (CAP_NET_RAW)";
  const std::string session = unique_session("capture");
  Participants museum{address(session, "museum")}, desk{address(session, "desk")};
  const std::vector<Bytes> messages = captured_stops(capture, museum, desk, "the needle is bent");
  EXPECT_TRUE(std::any_of(messages.begin(), messages.end(),
                          [](const Bytes& message) { return contains(message, "the needle is bent"); }));
}

TEST_F(ForgedTest, ACaptureShowsNoSampleAndNoMessageThatMustBeEncrypted) {
  Capture capture;
  if (!capture.is_permitted()) GTEST_SKIP() << "needs the right to capture packets (CAP_NET_RAW)";
  const std::vector<Bytes> messages = captured_stops(capture, museum_, desk_, "the needle is bent");
  std::size_t admitted = 0;
  for (const Bytes& message : messages) {
    EXPECT_FALSE(contains(message, "the needle is bent"));
    const Refusal refusal = refusal_of(message.data(), static_cast<std::uint32_t>(message.size()));
    // The library also sends these two kinds, which have no content; all receivers refuse them.
    EXPECT_THAT(refusal, AnyOf(Refusal::kNone, Refusal::kControl, Refusal::kLeave));
    admitted += refusal == Refusal::kNone ? 1 : 0;
  }
  EXPECT_GE(admitted, kCapturedStops) << "of " << messages.size() << ": the capture has missed the session";
}

TEST_F(ForgedTest, MessagesOfDiscoveryKeepTheirTimesOfSending) {
  Capture capture;
  if (!capture.is_permitted()) GTEST_SKIP() << "needs the right to capture packets (CAP_NET_RAW)";
  Reader<ses::ClockSample> reader{desk_, topics::kClock, [](ses::ClockSample&&) {}};
  Writer<ses::ClockSample> writer{museum_, topics::kClock};
  ASSERT_TRUE(eventually([&] { return writer.matched() == 1 && reader.matched() == 1; }));
  const std::vector<Bytes> messages = capture.messages(museum_.address().domain, true);
  ASSERT_FALSE(messages.empty());
  for (const Bytes& message : messages) {
    const auto first = submessage_at(message.data(), static_cast<std::uint32_t>(message.size()), kRtpsHeader);
    ASSERT_TRUE(first);
    EXPECT_NE(first->id, kSecurePrefixId) << "a trimmed message";
  }
}

TEST_F(ForgedTest, AMemberCannotSendInTheNameOfAnother) {
  Inbox<ses::EmergencyStop> inbox;
  Reader<ses::EmergencyStop> reader{desk_, topics::kStop, inbox.callback()};
  Participants liar{member("liar")};
  Writer<ses::EmergencyStop> writer{liar, topics::kStop};
  ASSERT_TRUE(send_until_received(writer, inbox, full_sample<ses::EmergencyStop>(liar)));

  liar.impl().participant_id = session::id_of("museum");  // as changed software would
  const auto forged = full_sample<ses::EmergencyStop>(liar);
  ASSERT_EQ(forged.origin.participant, session::id_of("museum"));
  const auto lied = Clock::now();
  EXPECT_TRUE(eventually([&] { return writer.send(forged) == SendStatus::kSent && reader.counts().refused > 3; }));
  while (const auto sample = inbox.next(0ms)) EXPECT_NE(sample->origin.participant, session::id_of("museum"));
  expect_in_audit_log({R"("event":"false sender","subject":"operator liar","detail":"tactus_stop")"}, lied);

  EXPECT_TRUE(eventually([&] {
    EXPECT_EQ(writer.send(forged), SendStatus::kSent);
    return reader.counts().refused >= Members::kMaxRefused;
  }));
  EXPECT_TRUE(
      is_in_audit_log(R"("event":"cut off","subject":"operator liar","detail":"too many refused samples, serial)"));
  EXPECT_TRUE(eventually([&] { return reader.matched() == 0; })) << "the library still sends to a member that lies";
}

TEST_F(ForgedTest, AnHrtcCannotSendStatesOfUsersThatItsKeysDoNotName) {
  Participants lab{member("lab", keys::Role::kHrtc, {"ann"})};
  Inbox<ses::ProbeState> inbox;
  Reader<ses::ProbeState> reader{desk_, topics::kProbeState, inbox.callback()};
  Writer<ses::ProbeState> writer{lab, topics::kProbeState};
  auto state = full_sample<ses::ProbeState>(lab);
  state.user_id = ses::id_of("ann");
  ASSERT_TRUE(send_until_received(writer, inbox, state));
  state.user_id = ses::id_of("bob");
  const auto lied = Clock::now();
  EXPECT_TRUE(eventually([&] { return writer.send(state) == SendStatus::kSent && reader.counts().refused > 3; }));
  while (const auto sample = inbox.next(0ms)) EXPECT_EQ(sample->user_id, ses::id_of("ann"));
  expect_in_audit_log({R"("event":"user not permitted","subject":"hrtc lab","detail":"tactus_probe_state")"}, lied);
}

TEST_F(ForgedTest, ASampleWithAWrongFieldIsInTheAuditLog) {
  const EndpointOptions of_user{user_partition("museum")};
  Inbox<ses::Intent> inbox;
  Reader<ses::Intent> reader{desk_, topics::kIntent, inbox.callback(), of_user};
  Writer<ses::Intent> writer{museum_, topics::kIntent, of_user};
  auto intent = full_sample<ses::Intent>(museum_);
  intent.user_id = ses::id_of("museum");
  ASSERT_TRUE(send_until_received(writer, inbox, intent));
  intent.user_id = ses::id_of("bob");
  EXPECT_TRUE(eventually([&] { return writer.send(intent) == SendStatus::kSent && reader.counts().invalid > 3; }));
  while (const auto sample = inbox.next(0ms)) EXPECT_EQ(sample->user_id, ses::id_of("museum"));
  EXPECT_TRUE(is_in_audit_log(R"("event":"invalid sample","subject":"operator museum",)"
                              R"("detail":"tactus_intent, user_id: expected the user of the partition")"));
}

TEST_F(ForgedTest, ASenderOfUndecodableSamplesIsInTheAuditLogAndCutOff) {
  Inbox<ses::EmergencyStop> inbox;
  Reader<ses::EmergencyStop> reader{desk_, topics::kStop, inbox.callback()};
  BytesWriter<ses::EmergencyStop> writer{museum_, topics::kStop};
  EXPECT_TRUE(
      eventually([&] { return writer.send(truncated_stop()) && reader.counts().invalid >= Members::kMaxRefused; }));
  EXPECT_TRUE(is_in_audit_log(R"("event":"invalid sample","subject":"operator museum",)"
                              R"("detail":"tactus_stop, encoding: expected the encoding of the type")"));
  EXPECT_TRUE(
      is_in_audit_log(R"("event":"cut off","subject":"operator museum","detail":"too many refused samples, serial)"));
  EXPECT_EQ(inbox.size(), 0u);
}

TEST_F(ForgedTest, ATapDropsInvalidSamplesAndTheirSenderIsInTheAuditLogAndCutOff) {
  Inbox<Bytes> inbox;
  const Tap tap = tap_of_stops([put = inbox.callback()](std::size_t, std::span<const std::uint8_t> bytes) {
    put(Bytes{bytes.begin(), bytes.end()});
  });
  BytesWriter<ses::EmergencyStop> writer{museum_, topics::kStop};
  const Bytes valid = encoded_stop(1), truncated = truncated_stop(), unnumbered = encoded_stop(0);
  ASSERT_TRUE(eventually([&] { return writer.send(valid) && inbox.next(10ms).has_value(); }));
  for (std::uint32_t i = 0; i < Members::kMaxRefused / 10; ++i)
    for (const Bytes& invalid : {truncated, unnumbered}) EXPECT_TRUE(writer.send(invalid));
  for (const char* reason : {"encoding: expected the encoding of the type", "number: expected at least 1"})
    EXPECT_TRUE(eventually([&] {
      return has_event({R"("event":"invalid sample","subject":"operator museum","detail":"tactus_stop, )", reason});
    })) << reason;
  EXPECT_TRUE(eventually(
      [&] { return writer.send(truncated) && has_event({R"("event":"cut off","subject":"operator museum")"}); }));
  while (const auto bytes = inbox.next(0ms)) EXPECT_EQ(*bytes, valid);
}

TEST_F(ForgedTest, AMemberThatSendsMoreThanTheRateOfATopicToATapIsInTheAuditLog) {
  const Tap tap = tap_of_stops([](std::size_t, std::span<const std::uint8_t>) {});
  Writer<ses::EmergencyStop> writer{museum_, topics::kStop};
  const auto stop = full_sample<ses::EmergencyStop>(museum_);
  EXPECT_TRUE(eventually([&] {
    constexpr std::uint32_t kMoreThanBurst = 2 * RateLimit::kMinBurst;
    for (std::uint32_t i = 0; i < kMoreThanBurst; ++i) EXPECT_EQ(writer.send(stop), SendStatus::kSent);
    return has_event({R"("event":"too many samples","subject":"operator museum","detail":"tactus_stop")"});
  }));
}

TEST_F(ForgedTest, AChunkOfAProgramWithoutAKnownIdHasAnEmptyListOfSenders) {
  EXPECT_THAT(desk_.impl().authors_of(dds::SampleInfo{}), testing::IsEmpty());
}

TEST_F(ForgedTest, AHostCannotOfferObjectsThatItsKeysDoNotName) {
  Participants vault{member("vault", keys::Role::kHost, {"vase"})};
  Inbox<ses::CatalogueEntry> inbox;
  Reader<ses::CatalogueEntry> reader{desk_, topics::kCatalogue, inbox.callback()};
  Writer<ses::CatalogueEntry> writer{vault, topics::kCatalogue};
  auto entry = full_sample<ses::CatalogueEntry>(vault);
  const auto offer = [&](const char* object) {
    entry.object = object;
    entry.object_id = ses::id_of(object);
    EXPECT_EQ(writer.send(entry), SendStatus::kSent);
  };
  offer("crate");
  offer("vase");
  const auto received = inbox.next();
  const auto refused = Clock::now();  // or before: the refused entry was sent first
  ASSERT_TRUE(received);
  EXPECT_EQ(received->object, "vase");
  expect_in_audit_log({R"("event":"object not permitted","subject":"host vault","detail":"tactus_catalogue")"},
                      refused);
}

TEST_F(ForgedTest, AMemberThatSendsMoreThanTheRateOfATopicIsInTheAuditLog) {
  Reader<ses::EmergencyStop> reader{desk_, topics::kStop, [](ses::EmergencyStop&&) {}};
  Writer<ses::EmergencyStop> writer{museum_, topics::kStop};
  const auto stop = full_sample<ses::EmergencyStop>(museum_);
  EXPECT_TRUE(eventually([&] { return writer.send(stop) == SendStatus::kSent && reader.counts().excess > 0; }));
  EXPECT_TRUE(is_in_audit_log(R"("event":"too many samples","subject":"operator museum","detail":"tactus_stop")"));
}

/// A program that writes and reads the roster.
struct RosterProgram {
  explicit RosterProgram(const SessionAddress& at) : participants{at} {}
  Participants participants;
  Writer<ses::RosterEntry> writer{participants, topics::kRoster};
  Reader<ses::RosterEntry> reader{participants, topics::kRoster, [](ses::RosterEntry&&) {}};
};

/// Starts a program at each address, and waits until all have found each other. A failure names the programs that have
/// not found all others.
void expect_all_find_each_other(const std::vector<SessionAddress>& addresses) {
  std::vector<std::unique_ptr<RosterProgram>> programs;
  for (const SessionAddress& at : addresses) programs.push_back(std::make_unique<RosterProgram>(at));
  const int others = static_cast<int>(programs.size()) - 1;
  std::string missing;
  EXPECT_TRUE(eventually([&] {
    missing.clear();
    for (const auto& program : programs) {
      const int writers = program->reader.matched(), readers = program->writer.matched();
      if (writers == others && readers == others) continue;
      missing += program->participants.address().participant + " has found " + std::to_string(writers) +
                 " writers and " + std::to_string(readers) + " readers of " + std::to_string(others) + "\n";
    }
    return missing.empty();
  })) << missing;
}

constexpr int kManyPrograms = 10;

TEST_F(ForgedTest, ManyMembersThatJoinAtOnceAllFindEachOther) {
  std::vector<SessionAddress> addresses;
  for (int i = 0; i < kManyPrograms; ++i) addresses.push_back(member("m" + std::to_string(i)));
  expect_all_find_each_other(addresses);
}

TEST(JoiningTest, ManyProgramsThatJoinAtOnceAllFindEachOther) {
  const std::string session = unique_session("many");
  std::vector<SessionAddress> addresses;
  for (int i = 0; i < kManyPrograms; ++i) addresses.push_back(address(session, "p" + std::to_string(i)));
  expect_all_find_each_other(addresses);
}

TEST_F(ForgedTest, AMemberThatIsRevokedDuringTheSessionIsCutOff) {
  Inbox<ses::EmergencyStop> inbox;
  Reader<ses::EmergencyStop> reader{desk_, topics::kStop, inbox.callback()};
  Writer<ses::EmergencyStop> writer{museum_, topics::kStop};
  const auto stop = full_sample<ses::EmergencyStop>(museum_);
  ASSERT_TRUE(send_until_received(writer, inbox, stop));

  std::filesystem::copy_file(museum_.address().keys / keys::files::kRevoked, folder_.path() / "before");
  authority_.revoke("museum");
  const auto revoked = std::chrono::steady_clock::now();
  EXPECT_TRUE(is_in_audit_log(R"("event":"cut off","subject":"operator museum","detail":"revoked, serial)"));
  EXPECT_LT(std::chrono::steady_clock::now() - revoked, 10s);
  while (inbox.next(0ms)) {
  }
  EXPECT_EQ(writer.send(stop), SendStatus::kSent);
  EXPECT_FALSE(inbox.next(500ms));
  Participants again{[&] {
    SessionAddress made = address(session_, "museum.2");
    made.keys = folder_.path() / "copy";  // has the earlier list of revoked certificates
    made.audit = audit_of("again");
    std::filesystem::copy(museum_.address().keys, made.keys);
    std::filesystem::copy_file(folder_.path() / "before", made.keys / keys::files::kRevoked,
                               std::filesystem::copy_options::overwrite_existing);
    return made;
  }()};
  EXPECT_TRUE(is_in_audit_log(R"("event":"cut off","subject":"operator museum","from":)"));
}

}  // namespace
}  // namespace tactus::wire::test
