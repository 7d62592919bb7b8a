/// Messages that a program without keys, or a member with changed software, sends into a secured session. They name
/// another member as their sender.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <sys/socket.h>

#include <string>
#include <vector>

#include "keys/authority.hpp"
#include "rtps_bytes.hpp"
#include "support.hpp"
#include "tests/support/temporary_folder.hpp"
#include "wire/convert.hpp"
#include "wire/dds.hpp"
#include "wire/transport/rtps_message.hpp"

namespace tactus::wire::test {
namespace {

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

template <class Sample>
Bytes encoded(const Sample& sample) {
  typename IdlOf<Sample>::Type converted;
  to_idl(sample, converted);
  typename IdlOf<Sample>::Support type;
  constexpr std::uint32_t kMaxBytes = 4096;
  rtps::SerializedPayload_t payload{kMaxBytes};
  EXPECT_TRUE(encode(type, converted, payload));
  Bytes bytes{payload.data, payload.data + payload.length};
  bytes.resize((bytes.size() + 3) / 4 * 4);
  return bytes;
}

/// A secured session of two members, in which `desk` reads what `museum` writes.
class ForgedTest : public testing::Test {
 protected:
  [[nodiscard]] std::filesystem::path audit_of(const std::string& name) const {
    return folder_.path() / (name + ".jsonl");
  }
  /// Waits for a line with this text in the audit log of `desk`.
  [[nodiscard]] bool is_in_audit_log(const std::string& text) const {
    return eventually([&] { return test_support::read_bytes(audit_of("desk")).find(text) != std::string::npos; });
  }
  [[nodiscard]] SessionAddress member(const std::string& name) const {
    SessionAddress made = address(session_, name);
    keys::NewMember wanted;
    wanted.name = name;
    wanted.role = keys::Role::kOperator;
    made.keys = authority_.add(wanted);
    made.audit = audit_of(name);
    return made;
  }

  test_support::TemporaryFolder folder_;
  std::string session_ = unique_session("forged");
  keys::Authority authority_ = keys::Authority::create(folder_.path() / "lab-keys");
  Participants museum_{member("museum")}, desk_{member("desk")};
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
      const Bytes sample = data({0, 0, static_cast<std::uint8_t>(entity), kind}, 1'000'000, encoded(forged));
      injector.send(message_of({sample}, prefix_of(museum_.impl().participant(TrafficClass::kProbe).guid())));
    }
  }
  while (const auto sample = inbox.next(500ms)) EXPECT_NE(sample->text, "forged");
  EXPECT_TRUE(is_in_audit_log(R"("event":"plain message","from":"127.0.0.1")"));
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
  EXPECT_TRUE(eventually([&] { return writer.send(forged) == SendStatus::kSent && reader.counts().refused > 3; }));
  while (const auto sample = inbox.next(0ms)) EXPECT_NE(sample->origin.participant, session::id_of("museum"));
  EXPECT_TRUE(is_in_audit_log(R"("event":"false sender","subject":"operator liar","detail":"tactus_stop")"));

  EXPECT_TRUE(eventually([&] {
    EXPECT_EQ(writer.send(forged), SendStatus::kSent);
    return reader.counts().refused >= Members::kMaxRefused;
  }));
  EXPECT_TRUE(is_in_audit_log(R"("event":"cut off","subject":"operator liar","detail":"too many refused samples")"));
  EXPECT_TRUE(eventually([&] { return reader.matched() == 0; })) << "the library still sends to a member that lies";
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
  EXPECT_TRUE(is_in_audit_log(R"("event":"cut off","subject":"operator museum","detail":"revoked")"));
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
