/// Many announcements of participants that do not exist. Each is valid and has another GUID, so the library discovers
/// the participant, and stores it until its lease ends.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <ctime>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "keys/identity.hpp"
#include "keys/member.hpp"
#include "rtps_bytes.hpp"
#include "support.hpp"
#include "tests/wire/secured_session.hpp"
#include "wire/footprint.hpp"
#include "wire/members.hpp"
#include "wire/transport/rtps_message.hpp"

namespace tactus::wire::test {
namespace {

Bytes little_endian(std::uint32_t number) {
  Bytes made;
  for (unsigned shift = 0; shift < 32; shift += 8) made.push_back(static_cast<std::uint8_t>(number >> shift));
  return made;
}

/// The announcement of a participant with this GUID (RTPS 2.2, 8.5.4.2 and 9.6.2.2), as Fast DDS sends it. Nothing
/// receives messages at its locators. `identity`: of a member; empty in a session without keys.
Bytes announcement(const GuidPrefix& sender, std::uint32_t lease_s, const std::string& identity = {}) {
  constexpr std::uint32_t kUdp = 1, kPort = 9;
  constexpr std::uint8_t kProtocol = 0x15, kVendor = 0x16, kGuid = 0x50, kMetatrafficLocator = 0x32, kLocator = 0x31,
                         kLease = 0x02, kEndpoints = 0x58, kUserData = 0x2c;
  Bytes payload{0, 3, 0, 0};
  const auto append = [](Bytes& to, const Bytes& bytes) { to.insert(to.end(), bytes.begin(), bytes.end()); };
  const auto add = [&](std::uint8_t id, Bytes value) {
    value.resize((value.size() + 3) / 4 * 4);
    append(payload, {id, 0, static_cast<std::uint8_t>(value.size()), static_cast<std::uint8_t>(value.size() >> 8u)});
    append(payload, value);
  };
  Bytes guid{sender.begin(), sender.end()};
  append(guid, {0, 0, 1, 0xc1});
  Bytes locator = little_endian(kUdp);
  append(locator, little_endian(kPort));
  append(locator, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 127, 0, 0, 1});
  Bytes lease = little_endian(lease_s);
  append(lease, {0, 0, 0, 0});
  add(kProtocol, {2, 3});
  add(kVendor, {1, 15});
  add(kGuid, guid);
  add(kMetatrafficLocator, locator);
  add(kLocator, locator);
  add(kLease, lease);
  add(kEndpoints, {0x3f, 0, 0, 0});  // discovery of participants, writers and readers
  if (!identity.empty()) {
    Bytes user_data = little_endian(static_cast<std::uint32_t>(identity.size()));
    user_data.insert(user_data.end(), identity.begin(), identity.end());
    add(kUserData, user_data);
  }
  append(payload, {1, 0, 0, 0});
  Bytes sample = data({kAnnouncements.begin(), kAnnouncements.end()}, 1, payload);
  constexpr std::size_t kReaderAt = 8;
  const Bytes reader{0x00, 0x01, 0x00, 0xc7};
  std::copy(reader.begin(), reader.end(), sample.begin() + kReaderAt);
  return message_of({sample}, sender);
}

/// Announces participants again and again to all programs of a session on this machine, until destruction.
class Flood {
 public:
  using Announcement = std::function<Bytes(std::uint32_t number)>;

  /// `from`: address of the sender. `announcement` returns that of each of the `participants`.
  Flood(int domain, const char* from, std::uint32_t participants, Announcement announcement)
      : domain_{domain}, participants_{participants}, announcement_{std::move(announcement)} {
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_addr.s_addr = inet_addr(from);
    EXPECT_EQ(::bind(socket_, reinterpret_cast<const sockaddr*>(&at), sizeof at), 0) << from;
    thread_ = std::thread{[this] { run(); }};
  }
  ~Flood() {
    is_ending_ = true;
    thread_.join();
    ::close(socket_);
  }
  Flood(const Flood&) = delete;
  Flood& operator=(const Flood&) = delete;

  /// Waits until each participant has been announced this number of times from now on.
  [[nodiscard]] bool announces_all(std::uint32_t times) const {
    const std::uint32_t end = sent_ + times * participants_;
    return eventually([&] { return sent_ >= end; });
  }

 private:
  void run() {
    constexpr std::chrono::milliseconds kPeriod{2};
    auto next = Clock::now();
    for (std::uint32_t number = 0; !is_ending_; number = (number + 1) % participants_) {
      send(announcement_(number));
      ++sent_;
      next += kPeriod;
      std::this_thread::sleep_until(next);
    }
  }
  void send(const Bytes& message) const {
    constexpr int kPrograms = 16;
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    for (int domain = domain_; domain < domain_ + kTrafficClasses; ++domain) {
      for (int program = 0; program < kPrograms; ++program) {
        to.sin_port = htons(static_cast<std::uint16_t>(own_port(domain, program)));
        (void)::sendto(socket_, message.data(), message.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
      }
    }
  }

  const int domain_;
  const std::uint32_t participants_;
  const Announcement announcement_;
  const int socket_ = ::socket(AF_INET, SOCK_DGRAM, 0);
  std::atomic<std::uint32_t> sent_{0};
  std::atomic<bool> is_ending_{false};
  std::thread thread_;
};

/// The stops that a program sends and receives.
struct Stops {
  explicit Stops(Participants& of) : participants{of} {}
  Participants& participants;
  Inbox<ses::EmergencyStop> inbox;
  Reader<ses::EmergencyStop> reader{participants, topics::kStop, inbox.callback()};
  Writer<ses::EmergencyStop> writer{participants, topics::kStop};
};

/// Sends stops with different texts, and waits for each.
bool reach(Stops& from, Stops& to) {
  constexpr int kSamples = 10;
  static int sent = 0;
  auto stop = full_sample<ses::EmergencyStop>(from.participants);
  for (int i = 0; i < kSamples; ++i) {
    stop.text = "stop " + std::to_string(++sent);
    const bool has_arrived = eventually([&] {
      if (from.writer.send(stop) == SendStatus::kInvalid) return false;
      const auto received = to.inbox.next(10ms);
      return received && received->text == stop.text;
    });
    if (!has_arrived) return false;
  }
  return true;
}

bool exchange(Stops& one, Stops& other) { return reach(one, other) && reach(other, one); }

/// A session without keys, of two programs that have found each other.
class PlainFloodTest : public testing::Test {
 protected:
  static Bytes of_stranger(std::uint32_t number) {
    constexpr std::uint32_t kLeaseSeconds = 1;
    GuidPrefix guid{0x01, 0x0f, 0xfa, 0x15, 0xe0};
    std::memcpy(&guid[8], &number, sizeof number);
    return announcement(guid, kLeaseSeconds);
  }

  const std::string session_ = unique_session("flood");
  Participants museum_{address(session_, "museum")}, desk_{address(session_, "desk")};
  Stops of_museum_{museum_}, of_desk_{desk_};
};

TEST_F(PlainFloodTest, ProgramsExchangeSamplesAndANewOneJoinsWhileTheLibraryHasPlacesLeft) {
  ASSERT_TRUE(exchange(of_museum_, of_desk_));
  constexpr std::uint32_t kStrangers = 200;  // of 255 places
  const Flood flood{test_domain(), "127.0.0.1", kStrangers, of_stranger};
  ASSERT_TRUE(flood.announces_all(2));
  EXPECT_TRUE(exchange(of_museum_, of_desk_));

  Participants late{address(session_, "late")};
  Stops of_late{late};
  EXPECT_TRUE(exchange(of_late, of_desk_));
  EXPECT_TRUE(exchange(of_late, of_museum_));
  EXPECT_TRUE(exchange(of_museum_, of_desk_));
}

TEST_F(PlainFloodTest, ProgramsExchangeSamplesWhileNoPlaceIsLeftAndOneThatStartsAfterwardsJoins) {
  ASSERT_TRUE(exchange(of_museum_, of_desk_));
  constexpr std::uint32_t kStrangers = 400;  // for 255 places
  {
    const Flood flood{test_domain(), "127.0.0.1", kStrangers, of_stranger};
    ASSERT_TRUE(flood.announces_all(2));
    EXPECT_TRUE(exchange(of_museum_, of_desk_));
  }
  std::this_thread::sleep_for(3s);  // nothing shows that the leases of the strangers, of a second, have ended
  Participants late{address(session_, "late")};
  Stops of_late{late};
  EXPECT_TRUE(exchange(of_late, of_desk_));
  EXPECT_TRUE(exchange(of_late, of_museum_));
}

class SecuredFloodTest : public SecuredSession {};

/// The announcements state the identity of a member, which everyone can read, and fit to its hash in the GUID.
TEST_F(SecuredFloodTest, MembersExchangeSamplesAndANewOneJoinsDuringAFloodFromAnotherAddress) {
  Stops of_museum{museum_}, of_desk{desk_};
  ASSERT_TRUE(exchange(of_museum, of_desk));
  const keys::Member museum = keys::read_member(museum_.address().keys, std::time(nullptr));
  const keys::Identity identity = keys::identity_of(museum, museum.name);
  const keys::GuidBegin begin = keys::guid_begin_of(museum.group, identity);
  const auto claim = [&, text = keys::text_of(identity)](std::uint32_t number) {
    constexpr std::uint32_t kLongestLease = static_cast<std::uint32_t>(Members::kMaxLease.count()) - 1;
    GuidPrefix guid{};
    std::copy(begin.begin(), begin.end(), guid.begin());
    guid[6] = 0xfa;
    std::memcpy(&guid[8], &number, sizeof number);
    return announcement(guid, kLongestLease, text);
  };
  constexpr std::uint32_t kClaims = 1000;
  const Flood flood{test_domain(), "127.0.0.2", kClaims, claim};
  ASSERT_TRUE(flood.announces_all(1));
  EXPECT_TRUE(is_in_audit_log(R"("event":"too many programs","from":"127.0.0.2")"));
  EXPECT_TRUE(exchange(of_museum, of_desk));

  Participants late{member("late")};
  Stops of_late{late};
  EXPECT_TRUE(exchange(of_late, of_desk));
  EXPECT_TRUE(exchange(of_late, of_museum));
  EXPECT_TRUE(exchange(of_museum, of_desk));
}

}  // namespace
}  // namespace tactus::wire::test
