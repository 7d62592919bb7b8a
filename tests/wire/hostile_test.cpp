#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <sys/socket.h>

#include <limits>
#include <random>
#include <string>

#include "session/check.hpp"
#include "support.hpp"
#include "wire/convert.hpp"
#include "wire/dds.hpp"

namespace tactus::wire::test {
namespace {

constexpr std::uint32_t kMaxEncoding = 70000;  // bytes

/// A type that has the name of another type, but whose samples are raw bytes. The writer of an attacker uses it.
class RawBytes final : public dds::TopicDataType {
 public:
#ifdef TACTUS_FAST_DDS_3
  RawBytes(const char* name, bool keyed) {
    set_name(name);
    max_serialized_type_size = kMaxEncoding;
    is_compute_key_provided = keyed;
  }
  bool serialize(const void* const data, rtps::SerializedPayload_t& payload, dds::DataRepresentationId_t) override {
    return copy(*static_cast<const std::string*>(data), payload);
  }
  bool deserialize(rtps::SerializedPayload_t&, void*) override { return true; }
  std::uint32_t calculate_serialized_size(const void* const data, dds::DataRepresentationId_t) override {
    return static_cast<std::uint32_t>(static_cast<const std::string*>(data)->size());
  }
  void* create_data() override { return new std::string; }
  void delete_data(void* data) override { delete static_cast<std::string*>(data); }
  bool compute_key(rtps::SerializedPayload_t&, rtps::InstanceHandle_t& handle, bool) override { return set(handle); }
  bool compute_key(const void* const, rtps::InstanceHandle_t& handle, bool) override { return set(handle); }
#else
  RawBytes(const char* name, bool keyed) {
    setName(name);
    m_typeSize = kMaxEncoding;
    m_isGetKeyDefined = keyed;
  }
  bool serialize(void* data, rtps::SerializedPayload_t* payload) override {
    return copy(*static_cast<std::string*>(data), *payload);
  }
  bool deserialize(rtps::SerializedPayload_t*, void*) override { return true; }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<std::uint32_t>(static_cast<std::string*>(data)->size()); };
  }
  void* createData() override { return new std::string; }
  void deleteData(void* data) override { delete static_cast<std::string*>(data); }
  bool getKey(void*, rtps::InstanceHandle_t* handle, bool) override { return set(*handle); }
#endif

 private:
  static bool copy(const std::string& bytes, rtps::SerializedPayload_t& payload) {
    std::copy(bytes.begin(), bytes.end(), payload.data);
    payload.length = static_cast<std::uint32_t>(bytes.size());
    payload.encapsulation = CDR_LE;
    return true;
  }
  static bool set(rtps::InstanceHandle_t& handle) {
    for (std::size_t i = 0; i < 16; ++i) handle.value[i] = 7;
    return true;
  }
};

/// A participant in the session of `victim` that can send invalid samples.
class DdsAttacker {
 public:
  template <class Sample>
  DdsAttacker(const Participants& victim, const TopicSpec<Sample>& topic, dds::TypeSupport type) {
    dds::DomainParticipantQos qos = dds::PARTICIPANT_QOS_DEFAULT;
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(std::make_shared<transport::UDPv4TransportDescriptor>());
    participant_ = dds::DomainParticipantFactory::get_instance()->create_participant(
        static_cast<dds::DomainId_t>(victim.address().domain + static_cast<int>(topic.traffic)), qos);
    type.register_type(participant_);
    dds::PublisherQos publisher = dds::PUBLISHER_QOS_DEFAULT;
    publisher.partition().push_back(victim.address().session.c_str());
    dds::DataWriterQos writer = dds::DATAWRITER_QOS_DEFAULT;
    writer.data_sharing().off();
    writer.durability().kind = dds::TRANSIENT_LOCAL_DURABILITY_QOS;
    writer.publish_mode().kind = dds::ASYNCHRONOUS_PUBLISH_MODE;
    writer.endpoint().history_memory_policy = rtps::DYNAMIC_RESERVE_MEMORY_MODE;
    writer.resource_limits().max_samples = writer.resource_limits().max_instances = 1000;
    writer.resource_limits().max_samples_per_instance = 1;
    writer_ = participant_->create_publisher(publisher)->create_datawriter(
        participant_->create_topic(topic.name, type.get_type_name(), dds::TOPIC_QOS_DEFAULT), writer);
  }
  ~DdsAttacker() {
    participant_->delete_contained_entities();
    dds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }
  void send(void* sample) { ASSERT_TRUE(succeeded(writer_->write(sample))); }

 private:
  dds::DomainParticipant* participant_ = nullptr;
  dds::DataWriter* writer_ = nullptr;
};

/// A reader that the intruder attacks, and a participant `friendly` whose samples are valid.
template <class Sample>
class Victim {
 public:
  explicit Victim(const TopicSpec<Sample>& topic) : reader{participants, topic, inbox.callback()} {}

  /// Sends until the reader has counted one more invalid sample.
  bool refuses(DdsAttacker& intruder, void* sample) {
    const std::uint64_t before = reader.counts().invalid;
    const auto end = std::chrono::steady_clock::now() + kWatchdog;
    while (std::chrono::steady_clock::now() < end) {
      intruder.send(sample);
      static_cast<void>(inbox.next(10ms));
      if (reader.counts().invalid > before) return true;
    }
    return false;
  }

  Participants participants{address(unique_session("hostile"), "victim")};
  Participants friendly{address(participants.address().session, "friend")};
  Inbox<Sample> inbox;
  Reader<Sample> reader;
};

template <class Sample>
dds::TypeSupport generated() {
  return dds::TypeSupport{new typename IdlOf<Sample>::Support};
}

TEST(Hostile, NonFiniteNumbersAreDroppedAndCounted) {
  Victim<ses::ProbeState> victim{topics::kProbeState};
  DdsAttacker intruder{victim.participants, topics::kProbeState, generated<ses::ProbeState>()};
  idl::ProbeState sample;
  to_idl(full_sample<ses::ProbeState>(victim.friendly), sample);
  sample.proxy()[2] = std::numeric_limits<double>::quiet_NaN();

  EXPECT_TRUE(victim.refuses(intruder, &sample));

  EXPECT_EQ(victim.reader.counts().received, 0u);
  EXPECT_THAT(victim.reader.invalid_reason(), testing::HasSubstr("proxy"));
}

TEST(Hostile, AnEnumeratorThatDoesNotExistIsDropped) {
  Victim<ses::Control> victim{topics::kControl};
  DdsAttacker intruder{victim.participants, topics::kControl, generated<ses::Control>()};
  idl::Control sample;
  to_idl(full_sample<ses::Control>(victim.friendly), sample);
  for (const std::uint32_t action : {5u, 256u, 258u, 0xffffffffu}) {  // 256 and 258 would be valid in 8 bits
    sample.action(static_cast<idl::ControlAction>(action));
    EXPECT_TRUE(victim.refuses(intruder, &sample)) << action;
  }
  EXPECT_EQ(victim.reader.counts().received, 0u);
}

TEST(Hostile, SamplesOfAnotherSessionAreCountedAsForeign) {
  Victim<ses::Control> victim{topics::kControl};
  DdsAttacker intruder{victim.participants, topics::kControl, generated<ses::Control>()};
  idl::Control sample;
  to_idl(full_sample<ses::Control>(victim.friendly), sample);
  sample.stamp().session(ses::id_of("elsewhere"));
  intruder.send(&sample);

  EXPECT_TRUE(eventually([&] { return victim.reader.counts().foreign > 0; }));
  EXPECT_EQ(victim.reader.counts().received, 0u);
}

// DDS stores an instance for each key, and frees none while their writer lives.
TEST(Hostile, EntriesOfManyProgramsDoNotHideALaterOne) {
  constexpr std::uint64_t kPrograms = 600;
  Victim<ses::RosterEntry> victim{topics::kRoster};
  DdsAttacker intruder{victim.participants, topics::kRoster, generated<ses::RosterEntry>()};
  idl::RosterEntry sample;
  to_idl(full_sample<ses::RosterEntry>(victim.friendly), sample);
  sample.stamp().session(ses::id_of("elsewhere"));
  ASSERT_TRUE(eventually([&] { return victim.reader.matched() == 1; }));
  std::uint64_t program = 0;
  EXPECT_TRUE(eventually([&] {  // some are lost
    if (program < kPrograms) sample.participant(++program);
    intruder.send(&sample);
    return program == kPrograms && victim.reader.counts().foreign > kPrograms / 2;
  }));

  Writer<ses::RosterEntry> writer{victim.friendly, topics::kRoster};
  EXPECT_TRUE(send_until_received(writer, victim.inbox, full_sample<ses::RosterEntry>(victim.friendly)).has_value());
}

/// The encoding of a valid sample, for tests to damage.
template <class Sample>
std::string encoding(const Sample& sample) {
  typename IdlOf<Sample>::Type idl_sample;
  to_idl(sample, idl_sample);
  typename IdlOf<Sample>::Support type;
  rtps::SerializedPayload_t payload{kMaxEncoding};
  EXPECT_TRUE(encode(type, idl_sample, payload));
  return std::string(reinterpret_cast<const char*>(payload.data), payload.length);
}

/// Sends `attacks` until the reader has counted `undecodable` invalid samples. Then a valid sample of another
/// participant must arrive.
template <class Sample>
void expect_survival(const TopicSpec<Sample>& topic, const std::vector<std::string>& attacks,
                     std::uint64_t undecodable) {
  Victim<Sample> victim{topic};
  const dds::TypeSupport imitated = generated<Sample>();
  DdsAttacker intruder{victim.participants, topic,
                       dds::TypeSupport{new RawBytes(imitated.get_type_name().c_str(), has_key(*imitated))}};
  ASSERT_TRUE(eventually([&] { return victim.reader.matched() == 1; }));
  EXPECT_TRUE(eventually([&] {  // repeated: best effort, and the endpoints match at different times
    for (std::string attack : attacks) intruder.send(&attack);
    return victim.reader.counts().invalid >= undecodable;
  }));

  Writer<Sample> writer{victim.friendly, topic};
  const auto sent = full_sample<Sample>(victim.friendly);
  const auto received = send_until_received(writer, victim.inbox, sent);

  ASSERT_TRUE(received.has_value());
  EXPECT_EQ(fields(*received), fields(sent)) << "an attack reached the callback";
}

TEST(Hostile, AReaderSurvivesBytesThatAreNoSample) {
  Participants participants{address(unique_session("bytes"), "x")};
  const std::string valid = encoding(full_sample<ses::Demand>(participants));
  std::vector<std::string> attacks{std::string(4, '\0'), std::string(4, '\xff'), std::string(400, '\xff'),
                                   valid.substr(0, valid.size() / 2)};
  constexpr std::size_t kBoolean = 4 + 8 + 8 + 24 + 8 + 8 + 4, kIntervalCount = kBoolean + 4;  // offsets
  std::string many_intervals = valid;                                                          // 2^32 - 1
  for (std::size_t i = 0; i < 4; ++i) many_intervals[kIntervalCount + i] = '\xff';
  attacks.push_back(many_intervals);
  std::string boolean_of_2 = valid;  // Fast CDR throws
  boolean_of_2[kBoolean] = 2;
  attacks.push_back(boolean_of_2);
  expect_survival(topics::kDemand, attacks, 1);  // with keep last 1, a later attack may replace an earlier one
}

TEST(Hostile, AReaderSurvivesASampleLargerThanItsType) {
  Participants participants{address(unique_session("large"), "x")};
  std::string large = encoding(full_sample<ses::BulkChunk>(participants));
  large.resize(60000, 'x');
  expect_survival(topics::kRecords, {large}, 0);  // DDS refuses the sample before it is decoded
}

TEST(Hostile, SamplesThatCannotBeDecodedCountForTheRateOfTheirSender) {
  Victim<ses::EmergencyStop> victim{topics::kStop};
  const dds::TypeSupport imitated = generated<ses::EmergencyStop>();
  DdsAttacker intruder{victim.participants, topics::kStop,
                       dds::TypeSupport{new RawBytes(imitated.get_type_name().c_str(), has_key(*imitated))}};
  std::string attack(12, '\0');
  EXPECT_TRUE(eventually([&] {
    intruder.send(&attack);
    return victim.reader.counts().excess > 0;
  }));
  EXPECT_GT(victim.reader.counts().invalid, 0u);
}

/// Decodes thousands of encodings that have a few changed bytes or are truncated. A sanitizer detects reads beyond the
/// end.
template <class Sample>
void expect_survival_of_changes() {
  const Participants participants{address(unique_session("changed"), "x")};
  const std::string valid = encoding(full_sample<Sample>(participants));
  Guarded<typename IdlOf<Sample>::Support> type{true};
  typename IdlOf<Sample>::Type decoded;
  Sample sample;
  constexpr std::uint32_t kEncapsulation = 4, kAttempts = 5000;
  std::uint32_t accepted = 0, refused = 0;
  std::minstd_rand random{7};
  const auto below = [&](std::size_t end) { return random() % end; };

  for (std::uint32_t i = 0; i < kAttempts; ++i) {
    std::string bytes = valid;
    for (std::size_t changes = below(4); changes > 0; --changes)
      bytes[kEncapsulation + below(bytes.size() - kEncapsulation)] =
          static_cast<char>(below(3) == 0 ? 0xff : below(256));
    if (below(4) == 0) bytes.resize(1 + below(bytes.size()));
    std::vector<rtps::octet> exact(bytes.begin(), bytes.end());
    rtps::SerializedPayload_t payload;
    payload.data = exact.data();
    payload.length = payload.max_size = static_cast<std::uint32_t>(exact.size());
    bool is_decoded = false;
    EXPECT_NO_THROW({
      is_decoded = type.decode(payload, &decoded);
      if (is_decoded) from_idl(decoded, sample);
    });
    payload.data = nullptr;  // owned by `exact`
    ++(is_decoded && invalid_field(sample) == nullptr ? accepted : refused);
  }

  EXPECT_GT(accepted, kAttempts / 10);
  EXPECT_GT(refused, kAttempts / 10);
}

TEST(Hostile, AReaderSurvivesCorruptedEncodings) {
  expect_survival_of_changes<ses::ObjectCopy>();
  expect_survival_of_changes<ses::Intent>();
  expect_survival_of_changes<ses::ProbeState>();
}

/// Sends datagrams to every port of this machine that participants of the session's domains use.
class UdpAttacker {
 public:
  explicit UdpAttacker(int domain) : domain_{domain}, socket_{socket(AF_INET, SOCK_DGRAM, 0)} {
    const in_addr loopback{htonl(INADDR_LOOPBACK)};
    setsockopt(socket_, IPPROTO_IP, IP_MULTICAST_IF, &loopback, sizeof loopback);
  }
  ~UdpAttacker() { close(socket_); }
  UdpAttacker(const UdpAttacker&) = delete;
  UdpAttacker& operator=(const UdpAttacker&) = delete;

  void send(const std::string& datagram) const {
    constexpr int kClasses = 3, kParticipants = 20;
    for (int domain = domain_; domain < domain_ + kClasses; ++domain) {
      const int base = 7400 + 250 * domain;  // RTPS 2.2, 9.6.1.1
      send(datagram, inet_addr("239.255.0.1"), base);
      for (int port = base + 10; port < base + 10 + 2 * kParticipants; ++port)
        send(datagram, htonl(INADDR_LOOPBACK), port);
    }
  }

 private:
  void send(const std::string& datagram, in_addr_t address, int port) const {
    sockaddr_in destination{};
    destination.sin_family = AF_INET;
    destination.sin_addr.s_addr = address;
    destination.sin_port = htons(static_cast<std::uint16_t>(port));
    sendto(socket_, datagram.data(), datagram.size(), 0, reinterpret_cast<const sockaddr*>(&destination),
           sizeof destination);
  }

  int domain_, socket_;
};

TEST(Hostile, AReaderSurvivesStatisticsBeforeTheEndOfAMessage) {
  Victim<ses::Control> victim{topics::kControl};
  const std::string header{"RTPS\x02\x03\x01\x0f stranger...", 20};  // with the vendor id of Fast DDS
  std::string statistics{"\x80\x01\x38\x00", 4};
  statistics.resize(60);
  const std::string padding{"\x01\x01\x04\x00....", 8};
  const UdpAttacker stranger{victim.participants.address().domain};
  stranger.send(header + statistics + padding);
  stranger.send(header + padding + statistics + statistics);
  stranger.send(header + statistics.substr(0, 10));

  Writer<ses::Control> writer{victim.friendly, topics::kControl};
  EXPECT_TRUE(send_until_received(writer, victim.inbox, full_sample<ses::Control>(victim.friendly)));
}

}  // namespace
}  // namespace tactus::wire::test
