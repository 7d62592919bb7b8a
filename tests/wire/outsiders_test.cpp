/// Programs that are not members, or no longer, write samples into a secured session. Its members accept none, and the
/// audit log names the program.
#include <gmock/gmock.h>

#include <ctime>

#include "keys/certificates.hpp"
#include "keys/documents.hpp"
#include "keys/identity.hpp"
#include "tests/wire/secured_session.hpp"
#include "wire/members.hpp"

namespace tactus::wire::test {
namespace {

/// The library sends a message of the handshake again after half a second, if the other end has not discovered the
/// sender yet.
constexpr std::chrono::milliseconds kHandshake = 1s;
/// Time between two announcements of a participant (qos/session.xml).
constexpr std::chrono::milliseconds kAnnouncement = 500ms;

class OutsiderTest : public SecuredSession {
 protected:
  /// Sends a stop again and again for a second. A member is matched within 0.1 s.
  static void send_for_a_second(Participants& from, Writer<ses::EmergencyStop>& writer) {
    auto stop = full_sample<ses::EmergencyStop>(from);
    stop.text = kFromOutside;
    for (const auto end = Clock::now() + 1s; Clock::now() < end; std::this_thread::sleep_for(10ms))
      EXPECT_NE(writer.send(stop), SendStatus::kInvalid);
  }
  static void expect_nothing_from_outside(Inbox<ses::EmergencyStop>& inbox) {
    while (const auto sample = inbox.next(0ms)) EXPECT_NE(sample->text, kFromOutside);
  }

  /// Starts a program that writes stops. `desk`, which accepts those of `museum`, accepts none. The audit log of `desk`
  /// has a line with all of these texts at most `limit` after the program has announced itself.
  void expect_refused(const SessionAddress& outsider, const std::vector<std::string>& event,
                      std::chrono::milliseconds limit = kMaxUntilLogged) {
    Inbox<ses::EmergencyStop> inbox;
    Reader<ses::EmergencyStop> reader{desk_, topics::kStop, inbox.callback()};
    Writer<ses::EmergencyStop> of_member{museum_, topics::kStop};
    ASSERT_TRUE(send_until_received(of_member, inbox, full_sample<ses::EmergencyStop>(museum_)));
    ASSERT_FALSE(has_event(event)) << "before the program starts";

    Participants participants{outsider};
    const auto announced = Clock::now();
    Writer<ses::EmergencyStop> writer{participants, topics::kStop};
    expect_in_audit_log(event, announced, limit);
    send_for_a_second(participants, writer);
    expect_nothing_from_outside(inbox);
    EXPECT_EQ(writer.matched(), 0);
    EXPECT_EQ(reader.matched(), 1) << "only the member";
  }

  /// The keys of a program, made by another authority of the same name. Only the signature of the certificate is wrong:
  /// the identity that the program states matches its GUID. The participant with the smaller GUID begins the handshake.
  [[nodiscard]] SessionAddress wrongly_signed(bool begins_handshake) const {
    std::filesystem::create_directory(folder_.path() / "elsewhere");
    const keys::Authority other = keys::Authority::create(folder_.path() / "elsewhere/lab-keys");
    keys::NewMember forger;
    forger.name = "forger";
    forger.role = keys::Role::kOperator;
    forger.replaces = true;
    const auto guid_of = [](const std::filesystem::path& folder) {
      const keys::Member read = keys::read_member(folder, std::time(nullptr));
      return keys::guid_begin_of(read.group, keys::identity_of(read, read.name));
    };
    std::filesystem::path folder = other.add(forger);
    while ((guid_of(folder) < guid_of(desk_.address().keys)) != begins_handshake) folder = other.add(forger);
    return with_keys("forger", folder);
  }

  /// Replaces the certificate of a member by one that expires at this time.
  void let_expire(const std::filesystem::path& folder, std::time_t until) const {
    using namespace keys::files;
    const std::filesystem::path authority = folder_.path() / "lab-keys/authority";
    const keys::Issuer identities{keys::read_certificate(authority / kIdentityCa),
                                  keys::read_key(authority / "identity-ca.key")},
        permissions{keys::read_certificate(authority / kPermissionsCa),
                    keys::read_key(authority / "permissions-ca.key")};
    const keys::Member read = keys::read_member(folder, std::time(nullptr));
    const keys::Certificate earlier = keys::read_certificate(folder / kCertificate);
    const keys::Certificate made = keys::issue(identities, keys::subject_of(*earlier),
                                               *keys::read_key(folder / kPrivateKey), read.valid_from, until);
    test_support::write_bytes(folder / kCertificate, keys::pem_of(*made));
    test_support::write_bytes(
        folder / kPermissions,
        keys::sign(permissions, keys::permissions_document(keys::subject_text(*made), read.role, read.permitted,
                                                           read.valid_from, until)));
  }

  static constexpr const char* kFromOutside = "from outside";
};

TEST_F(OutsiderTest, AProgramWithoutKeysIsNamedAndCannotWrite) {
  // It states no name, so the address of its sender is all that is known.
  expect_refused(address(session_, "plain"), {R"("event":"unknown program","from":")"});
}

TEST_F(OutsiderTest, AProgramWithKeysOfAnotherAuthorityIsNamedAndCannotWrite) {
  keys::NewMember foreign;
  foreign.name = "foreign";
  foreign.role = keys::Role::kOperator;
  const keys::Authority other = keys::Authority::create(folder_.path() / "other-keys");
  expect_refused(with_keys("foreign", other.add(foreign)),
                 {R"("event":"unknown program","from":")", R"("detail":"states to be operator foreign")"});
}

TEST_F(OutsiderTest, AProgramWhoseCertificateIsWronglySignedIsNamedAndCannotWrite) {
  expect_refused(wrongly_signed(true), {R"("event":"not authenticated","detail":"states to be operator forger")"},
                 kMaxUntilLogged + kHandshake);
}

/// Here `desk` begins the handshake. The program refuses the certificate of `desk` and never answers. The library
/// reports no failure, so only the time shows that the program does not prove its identity.
TEST_F(OutsiderTest, AProgramThatDoesNotAnswerInTheHandshakeIsNamedAndCannotWrite) {
  expect_refused(wrongly_signed(false),
                 {R"("event":"not authenticated","detail":"states to be operator forger, and does not prove it")"},
                 Members::kMaxHandshake + kAnnouncement + kMaxUntilLogged);
}

/// A program with an expired certificate does not start. So this one starts before its certificate expires.
TEST_F(OutsiderTest, AProgramWhoseCertificateHasExpiredIsNamedAndCannotWrite) {
  // s, time for the program to join on a busy machine
  constexpr std::time_t kValid = test_support::kSanitized ? 15 : 6;
  const SessionAddress late = member("late");
  const std::time_t until = std::time(nullptr) + kValid;
  let_expire(late.keys, until);
  Inbox<ses::EmergencyStop> inbox;
  Reader<ses::EmergencyStop> reader{desk_, topics::kStop, inbox.callback()};
  Participants participants{late};
  Writer<ses::EmergencyStop> writer{participants, topics::kStop};
  ASSERT_TRUE(send_until_received(writer, inbox, full_sample<ses::EmergencyStop>(participants)))
      << "while the certificate is valid";
  ASSERT_TRUE(eventually([&] { return std::time(nullptr) > until; }));

  // A program that starts now refuses the announcement.
  Inbox<ses::EmergencyStop> inbox_of_new;
  SessionAddress of_lab = member("lab"), of_view = member("view");
  of_lab.only_reads_bulk = of_view.only_reads_bulk = true;
  Participants lab{of_lab};
  const auto joined = Clock::now();
  const Participants view{of_view};
  Reader<ses::EmergencyStop> reader_of_new{lab, topics::kStop, inbox_of_new.callback()};
  expect_in_audit_log(
      {R"("event":"cut off","subject":"operator late","from":")", R"("detail":"expired, serial number )"}, joined,
      kMaxUntilLogged + kAnnouncement, "lab");

  // One that has accepted the program earlier checks its certificate every 5 s, as for revoked ones.
  ASSERT_TRUE(eventually(
      [&] { return has_event({R"("event":"cut off","subject":"operator late","detail":"expired, serial number )"}); }));
  EXPECT_LT(std::time(nullptr) - until, test_support::kSanitized ? 20 : 10);
  while (inbox.next(0ms)) {  // samples of the time before
  }
  send_for_a_second(participants, writer);
  expect_nothing_from_outside(inbox);
  expect_nothing_from_outside(inbox_of_new);
  EXPECT_EQ(reader_of_new.matched(), 0);
  for (const char* program : {"desk", "lab"})
    EXPECT_FALSE(has_event({"not authenticated"}, program))
        << "a program needs no handshake with itself, and programs that only read bulk have none in that class";
}

}  // namespace
}  // namespace tactus::wire::test
