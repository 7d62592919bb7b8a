#include "wire/members.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstring>
#include <string>
#include <vector>

#include "keys/authority.hpp"
#include "keys/certificates.hpp"
#include "rtps_bytes.hpp"
#include "session/messages.hpp"
#include "tests/support/file_size_limit.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::wire {
namespace {

using namespace std::chrono_literals;
using namespace test;
using keys::Role;
using testing::HasSubstr;
using testing::Not;

class MembersTest : public testing::Test {
 protected:
  keys::Member add(const std::string& name, Role role, keys::Permitted permitted = {}) {
    keys::NewMember member;
    member.name = name;
    member.role = role;
    member.permitted = std::move(permitted);
    return keys::read_member(authority_.add(member), now_);
  }
  /// Makes new keys for a member, and revokes the earlier ones.
  keys::Member replace(const std::string& name, Role role) {
    keys::NewMember again;
    again.name = name;
    again.role = role;
    again.replaces = true;
    return keys::read_member(authority_.add(again), now_);
  }
  /// A participant of the program of this member.
  static GuidPrefix prefix_of(const keys::Member& member, std::uint8_t number = 1) {
    const keys::GuidBegin begin = keys::guid_begin_of(member.group, keys::identity_of(member, member.name));
    GuidPrefix prefix{};
    std::copy(begin.begin(), begin.end(), prefix.begin());
    prefix.back() = number;
    return prefix;
  }
  static Bytes announcement(const GuidPrefix& sender, const std::string& identity, std::uint32_t lease_s = 0) {
    Bytes payload{0, 3, 0, 0};
    const auto add_parameter = [&](std::uint8_t id, Bytes value) {
      value.resize((value.size() + 3) / 4 * 4);
      payload.insert(payload.end(),
                     {id, 0, static_cast<std::uint8_t>(value.size()), static_cast<std::uint8_t>(value.size() >> 8u)});
      payload.insert(payload.end(), value.begin(), value.end());
    };
    Bytes guid(sender.begin(), sender.end());
    guid.insert(guid.end(), {0, 0, 1, 0xc1});
    add_parameter(0x50, guid);
    Bytes lease;
    for (unsigned shift = 0; shift < 32; shift += 8) lease.push_back(static_cast<std::uint8_t>(lease_s >> shift));
    lease.resize(8);  // without fraction
    add_parameter(0x02, lease);
    Bytes text{static_cast<std::uint8_t>(identity.size()), 0, 0, 0};
    text.insert(text.end(), identity.begin(), identity.end());
    add_parameter(0x2c, text);
    payload.insert(payload.end(), {1, 0, 0, 0});
    return data({0x00, 0x01, 0x00, 0xc2}, 1, payload);
  }
  /// Returns the payload of a message of the authentication with this program as its destination.
  Bytes for_this_program(Bytes payload) const {
    const keys::GuidBegin begin = keys::guid_begin_of(self_.group, keys::identity_of(self_, "desk"));
    std::copy(begin.begin(), begin.end(), payload.begin() + 52);
    return payload;
  }
  bool admits(const std::vector<Bytes>& parts, const GuidPrefix& sender, const char* from = "10.0.0.9") {
    const Bytes message = message_of(parts, sender);
    return members_.admits(message.data(), static_cast<std::uint32_t>(message.size()), [&] { return from; });
  }
  bool admits(const keys::Member& member, const std::string& participant) {
    const GuidPrefix sender = prefix_of(member);
    const bool is_admitted = admits({announcement(sender, text_of(keys::identity_of(member, participant)))}, sender);
    if (is_admitted) members_.on_authentication(sender, true);
    return is_admitted;
  }
  std::string audit() {
    EXPECT_EQ(audit_.write(0, true), "");
    return test_support::read_bytes(folder_.path() / "audit.jsonl");
  }

  /// Returns the messages after the program got a list of these revoked keys that was made at this time.
  std::vector<std::string> after_list_of(std::time_t made, const std::vector<std::string>& serials = {}) {
    const std::filesystem::path authority = folder_.path() / "lab-keys/authority";
    const keys::Issuer issuer{keys::read_certificate(authority / keys::files::kIdentityCa),
                              keys::read_key(authority / "identity-ca.key")};
    test_support::write_bytes(authority_.folder_of("desk") / keys::files::kRevoked,
                              keys::pem_of(*keys::make_revoked_list(issuer, serials, made)));
    return members_.check_again(now_);
  }

  void pass(std::chrono::nanoseconds time) { clock_ns_ += time.count(); }

  const std::time_t now_ = std::time(nullptr);
  std::int64_t clock_ns_ = std::chrono::nanoseconds{1h}.count();
  test_support::TemporaryFolder folder_;
  keys::Authority authority_ = keys::Authority::create(folder_.path() / "lab-keys");
  keys::Member self_ = add("desk", Role::kHrtc);
  AuditLog audit_{folder_.path() / "audit.jsonl", "lab", "desk"};
  Members members_{authority_.folder_of("desk"), self_, "desk", audit_, [this] { return clock_ns_; }};
};

TEST_F(MembersTest, AProgramIsAdmittedWithTheIdentityOfItsKeys) {
  const keys::Member museum = add("museum", Role::kHost), ann = add("ann", Role::kOperator);
  EXPECT_TRUE(admits(museum, "museum"));
  EXPECT_TRUE(admits(ann, "ann.control-7"));
  EXPECT_THAT(members_.ids_of(prefix_of(museum)), testing::ElementsAre(session::id_of("museum")));
  EXPECT_THAT(members_.ids_of(prefix_of(ann)), testing::ElementsAre(session::id_of("ann.control-7")));
  EXPECT_THAT(audit(), Not(HasSubstr("unknown program")));
}

class RemovedTest : public MembersTest {
 protected:
  [[nodiscard]] bool announces() {
    return admits({announcement(sender_, text_of(keys::identity_of(museum_, "museum")))}, sender_);
  }
  [[nodiscard]] bool sends_encrypted() { return admits({submessage(kSecurePrefixId, Bytes(20))}, sender_); }
  /// The museum announces that it has removed this program. Returns whether its messages are refused then.
  [[nodiscard]] bool removes_this() {
    members_.on_removed_by(sender_);
    return !announces();
  }

  const keys::Member museum_ = add("museum", Role::kHost);
  const GuidPrefix sender_ = prefix_of(museum_);
};

TEST_F(RemovedTest, ASilentParticipantThatHasRemovedThisOneIsRefusedUntilItIsGone) {
  EXPECT_FALSE(removes_this()) << "its identity is not proved";
  members_.on_authentication(sender_, true);
  pass(Members::kMinProved - 1ms);
  EXPECT_FALSE(removes_this()) << "its identity has just been proved";
  ASSERT_TRUE(sends_encrypted());
  pass(Members::kMinSilence - 1ms);
  EXPECT_FALSE(removes_this()) << "its encrypted messages arrive";
  pass(1ms);
  EXPECT_TRUE(removes_this());
  EXPECT_FALSE(sends_encrypted());
  EXPECT_THAT(audit(), HasSubstr(R"("event":"removed by peer","subject":"host museum")"));
  members_.on_gone(sender_);
  EXPECT_TRUE(announces());
}

TEST_F(RemovedTest, TheRefusalEndsEvenIfTheLibraryDoesNotReportTheEndOfTheLease) {
  ASSERT_TRUE(announces());
  members_.on_authentication(sender_, true);
  pass(Members::kMinProved);
  ASSERT_TRUE(removes_this());
  pass(2s);  // two leases
  EXPECT_TRUE(announces());
}

TEST_F(RemovedTest, RemovedParticipantsAreThoseThatAnnounceThemselvesAgain) {
  ASSERT_TRUE(announces());
  EXPECT_THAT(members_.removed(), testing::IsEmpty()) << "it was not removed";
  members_.on_authentication(sender_, true);
  members_.on_gone(sender_);
  EXPECT_THAT(members_.removed(), testing::IsEmpty()) << "it may be gone for ever";
  ASSERT_TRUE(announces());
  EXPECT_THAT(members_.removed(), testing::ElementsAre(sender_));
  members_.on_authentication(sender_, true);
  EXPECT_THAT(members_.removed(), testing::IsEmpty());
}

TEST_F(RemovedTest, TheNewestRemovalIsTheFirst) {
  const GuidPrefix second = prefix_of(museum_, 2), third = prefix_of(museum_, 3);
  const auto identity = text_of(keys::identity_of(museum_, "museum"));
  for (const GuidPrefix& prefix : {second, third, sender_}) {
    ASSERT_TRUE(admits({announcement(prefix, identity)}, prefix));
    members_.on_authentication(prefix, true);
    pass(1ms);
    members_.on_gone(prefix);
    ASSERT_TRUE(admits({announcement(prefix, identity)}, prefix));
  }
  EXPECT_THAT(members_.removed(), testing::ElementsAre(sender_, third, second));
}

TEST_F(RemovedTest, AParticipantThatIsGoneDuringItsHandshakeCountsAsRemoved) {
  ASSERT_TRUE(announces());
  members_.on_gone(sender_);
  ASSERT_TRUE(announces());
  EXPECT_THAT(members_.removed(), testing::IsEmpty()) << "it has sent no handshake";
  ASSERT_TRUE(admits(
      {data({0x00, 0x02, 0x01, 0xc3}, 1, for_this_program(handshake({sender_.begin(), sender_.end()}, {}, Bytes(4))))},
      sender_));
  members_.on_gone(sender_);
  ASSERT_TRUE(announces());
  EXPECT_THAT(members_.removed(), testing::ElementsAre(sender_));
}

TEST_F(MembersTest, NobodyIsAdmittedWithAnotherIdentity) {
  const keys::Member museum = add("museum", Role::kHost), ann = add("ann", Role::kUser);
  const GuidPrefix sender = prefix_of(ann);
  keys::Identity better = keys::identity_of(ann, "ann"), later = better, more = better;
  better.role = Role::kOperator;
  later.valid_until += 1;
  more.permitted.push_back("bob");
  for (const std::string& text :
       {text_of(keys::identity_of(museum, "museum")), text_of(better), text_of(later), text_of(more),
        text_of(keys::identity_of(ann, "museum")), text_of(keys::identity_of(ann, "annabel")),
        text_of(keys::identity_of(ann, "ann.")), std::string{}, std::string(900, 'x')})
    EXPECT_FALSE(admits({announcement(sender, text)}, sender)) << text;
  EXPECT_THAT(audit(), HasSubstr(R"("event":"unknown program","from":"10.0.0.9","detail":"states to be host museum")"));
  const Bytes honest = announcement(sender, text_of(keys::identity_of(ann, "ann")));
  EXPECT_FALSE(admits({honest, announcement(prefix_of(museum), text_of(keys::identity_of(museum, "museum")))}, sender))
      << "a second announcement in the message, with the GUID of another participant";
}

TEST_F(MembersTest, TextsThatNoAuthorityIssuesAreRefused) {
  const keys::Member ann = add("ann", Role::kUser);
  const std::string until = std::to_string(ann.valid_until);
  for (const std::string& text : std::vector<std::string>{
           "user\n" + std::string(65, 'a') + "\n0A\n" + until + "\nann\n" + std::string(65, 'a'),
           "user\nann\xff\n0A\n" + until + "\nann\nann\xff", "user\nann\n@\n" + until + "\nann\nann",
           "user\nann\n0A\n-1\nann\nann", "user\nann\n0A\n99999999999999999999\nann\nann",
           "user\nann\n0A\n" + until + "\nann\nann.\x1b[31m", "user\nann\n0A\n" + until + "\n*\nann",
           "user\nann\n0A\n" + until + "\nann  bob\nann",
           "user\nann\n0A\n" + until + "\n" + std::string(600, 'a') + "\nann"})
    EXPECT_FALSE(keys::read_identity(text)) << text;
  EXPECT_TRUE(keys::read_identity("user\nann\n0A\n" + until + "\nann bob\nann"));
}

TEST_F(MembersTest, AnAnnouncementCannotNameAnotherParticipantToTheLibrary) {
  const keys::Member ann = add("ann", Role::kUser), museum = add("museum", Role::kHost);
  ASSERT_TRUE(admits(ann, "ann"));
  const std::string identity = text_of(keys::identity_of(ann, "ann"));
  Bytes key_hash{0, 3, 0, 0, 0x70, 0, 16, 0};
  const GuidPrefix other = prefix_of(museum);
  key_hash.insert(key_hash.end(), other.begin(), other.end());
  key_hash.insert(key_hash.end(), {0, 0, 1, 0xc1, 1, 0, 0, 0});
  EXPECT_FALSE(admits({data({0x00, 0x01, 0x00, 0xc2}, 1, key_hash)}, prefix_of(ann)));
  EXPECT_FALSE(admits({kInfoTime}, prefix_of(museum))) << "it has not announced itself";
}

TEST_F(MembersTest, AHandshakeHasTheCertificateThatItsSenderAnnounces) {
  const keys::Member museum = add("museum", Role::kHost), ann = add("ann", Role::kUser);
  const GuidPrefix sender = prefix_of(ann);
  const std::string identity = text_of(keys::identity_of(ann, "ann"));
  ASSERT_TRUE(admits({announcement(sender, identity)}, sender));
  const auto admits_certificate = [&](const std::string& text) {
    return admits(
        {data({0x00, 0x02, 0x01, 0xc3}, 1,
              for_this_program(handshake({sender.begin(), sender.end()}, {text.begin(), text.end()}, Bytes(4))))},
        sender);
  };
  const auto certificate_of = [&](const char* name) {
    return test_support::read_bytes(authority_.folder_of(name) / keys::files::kCertificate);
  };
  EXPECT_TRUE(admits_certificate(certificate_of("ann")));
  EXPECT_THAT(audit(), Not(HasSubstr("authentication of another participant")));
  authority_.revoke("museum");  // the library has read its list of revoked certificates before
  EXPECT_FALSE(admits_certificate(certificate_of("museum")));
  EXPECT_FALSE(admits_certificate(certificate_of("museum") + certificate_of("ann"))) << "the library reads the first";
  EXPECT_FALSE(admits_certificate("no certificate"));
  EXPECT_THAT(audit(), HasSubstr(R"("event":"authentication of another participant","from":"10.0.0.9","count":3)"));
}

// The thief of the keys of the museum is still there, and the list that revokes them has not arrived yet.
class ReplacedTest : public MembersTest {
 protected:
  ReplacedTest() {
    for (const keys::Member& member : {earlier_, replacement_}) {
      const GuidPrefix sender = prefix_of(member);
      EXPECT_TRUE(admits({announcement(sender, text_of(keys::identity_of(member, "museum")))}, sender));
    }
    for (const keys::Member& member : {earlier_, replacement_}) members_.on_authentication(prefix_of(member), true);
    for (std::uint32_t i = 0; i < 2 * Members::kMaxRefused; ++i) EXPECT_FALSE(counts(replacement_));
    EXPECT_THAT(audit(), Not(HasSubstr("cut off")));
  }
  bool counts(const keys::Member& member) {
    return members_.is_author(prefix_of(member), {session::id_of("museum")}, "tactus_object_pose");
  }

  const keys::Member earlier_ = add("museum", Role::kHost), replacement_ = replace("museum", Role::kHost);
};

TEST_F(ReplacedTest, TheReplacementCountsWhenTheListArrives) {
  EXPECT_THAT(members_.check_again(now_), testing::ElementsAre(HasSubstr("read a new list: 1 revoked key"),
                                                               HasSubstr("the keys of host museum are revoked")));
  EXPECT_TRUE(counts(replacement_));
  EXPECT_FALSE(counts(earlier_));
}

TEST_F(ReplacedTest, TheReplacementCountsWhenItsPredecessorIsGone) {
  members_.on_gone(prefix_of(earlier_));
  EXPECT_TRUE(counts(replacement_));
  EXPECT_FALSE(counts(earlier_));
}

TEST_F(MembersTest, AForgedNameOfAProgramDoesNotReplaceItsName) {
  const keys::Member museum = add("museum", Role::kHost);
  ASSERT_TRUE(admits(museum, "museum.x"));  // by someone who repeats the announcement with another name
  ASSERT_TRUE(admits(museum, "museum"));
  EXPECT_TRUE(members_.is_author(prefix_of(museum), {session::id_of("museum")}, "tactus_roster"));
}

// A program that starts receives the forged announcements first, and stores only four names.
TEST_F(MembersTest, ManyForgedNamesOfAProgramDoNotDivertItsSamples) {
  const keys::Member museum = add("museum", Role::kHost);
  const GuidPrefix sender = prefix_of(museum);
  for (const char* const name : {"museum.a", "museum.b", "museum.c", "museum.d", "museum"})
    ASSERT_TRUE(admits({announcement(sender, text_of(keys::identity_of(museum, name)))}, sender));
  members_.on_authentication(sender, true);
  const std::uint64_t id = session::id_of("museum");
  for (std::uint32_t i = 0; i < 2 * Members::kMaxRefused; ++i)
    EXPECT_FALSE(members_.is_author(sender, {id}, "tactus_object_pose")) << "no sample has stated the name";
  session::RosterEntry entry;
  entry.role = session::Role::kHost;
  entry.name = "museum";
  EXPECT_TRUE(members_.is_author(sender, {id, 0, 0, &entry, &entry.name}, "tactus_roster"));
  EXPECT_TRUE(members_.is_author(sender, {id}, "tactus_object_pose"));
  EXPECT_THAT(members_.ids_of(sender), testing::Contains(id)) << "the sender of its chunks";
  EXPECT_THAT(audit(), Not(HasSubstr("cut off")));
}

TEST_F(MembersTest, ANameInASampleCountsOnlyForItsMember) {
  const keys::Member museum = add("museum", Role::kHost), ann = add("ann", Role::kUser);
  ASSERT_TRUE(admits(museum, "museum"));
  ASSERT_TRUE(admits(ann, "ann"));
  session::RosterEntry entry;
  entry.name = "museum";
  const std::uint64_t museum_id = session::id_of("museum");
  EXPECT_FALSE(members_.is_author(prefix_of(ann), {museum_id, 0, 0, &entry, &entry.name}, "tactus_roster"));
  entry.name = "ann.y";
  EXPECT_FALSE(members_.is_author(prefix_of(ann), {museum_id, 0, 0, &entry, &entry.name}, "tactus_roster"));
}

// An id is a hash of 64 bits of a name, and a member may choose a name. Here it chooses the same name.
TEST_F(MembersTest, TheIdOfThisProgramIsRefusedToOthers) {
  const keys::Member ann = add("ann", Role::kUser);
  Members receiver{authority_.folder_of("desk"), self_, "ann.x", audit_};
  const GuidPrefix sender = prefix_of(ann);
  const auto admits_name = [&](const char* name) {
    const Bytes message = message_of({announcement(sender, text_of(keys::identity_of(ann, name)))}, sender);
    return receiver.admits(message.data(), static_cast<std::uint32_t>(message.size()), [] { return "10.0.0.9"; });
  };
  EXPECT_FALSE(admits_name("ann.x"));
  EXPECT_TRUE(admits_name("ann"));
  EXPECT_TRUE(admits_name("ann.x")) << "the participant is known by its other name";
  receiver.on_authentication(sender, true);
  session::RosterEntry entry;
  entry.name = "ann.x";
  const std::uint64_t id = session::id_of(entry.name);
  EXPECT_FALSE(receiver.is_author(sender, {id}, "tactus_roster"));
  EXPECT_FALSE(receiver.is_author(sender, {id, 0, 0, &entry, &entry.name}, "tactus_roster")) << "with its name";
  EXPECT_THAT(audit(), HasSubstr(R"("detail":"claims to be user ann, with the id of another program")"));
}

TEST_F(MembersTest, ASampleCountsIfItsAuthorClaimsItAndMayWriteIt) {
  const keys::Member museum = add("museum", Role::kHost), ann = add("ann", Role::kUser);
  ASSERT_TRUE(admits(museum, "museum"));
  ASSERT_TRUE(admits(ann, "ann"));
  const std::uint64_t museum_id = session::id_of("museum"), ann_id = session::id_of("ann");
  EXPECT_TRUE(members_.is_author(prefix_of(museum), {museum_id}, "tactus_catalogue"));
  EXPECT_TRUE(members_.is_author(prefix_of(museum), {}, "tactus_records"));
  EXPECT_FALSE(members_.is_author(prefix_of(ann), {museum_id}, "tactus_roster"));
  EXPECT_FALSE(members_.is_author(prefix_of(ann), {0}, "tactus_roster")) << "in nobody's name";
  EXPECT_FALSE(members_.is_author(prefix_of(ann), {ann_id}, "tactus_reset"));
  EXPECT_FALSE(members_.is_author(prefix_of(ann), {}, "tactus_records"));
  EXPECT_FALSE(members_.is_author(prefix_of(ann, 2), {ann_id}, "tactus_roster")) << "a participant that nobody knows";
  const std::string log = audit();
  EXPECT_THAT(log, HasSubstr(R"("event":"false sender","subject":"user ann","detail":"tactus_roster","count":2)"));
  EXPECT_THAT(log, HasSubstr(R"("event":"not permitted","subject":"user ann","detail":"tactus_reset","count":1)"));
  EXPECT_THAT(log, Not(HasSubstr(R"("subject":"host museum","detail")")));
}

TEST_F(MembersTest, KeysRestrictAnHrtcToItsUsersAndAHostToItsObjects) {
  const keys::Member desk = add("lab", Role::kHrtc, {"ann", "bob"}), open = add("open", Role::kHrtc);
  const keys::Member museum = add("museum", Role::kHost, {"vase"});
  ASSERT_TRUE(admits(desk, "lab") && admits(open, "open") && admits(museum, "museum"));
  const auto of_user = [&](const keys::Member& member, const std::string& user) {
    return members_.is_author(prefix_of(member), {session::id_of(member.name), session::id_of(user)},
                              "tactus_probe_state");
  };
  EXPECT_TRUE(of_user(desk, "ann"));
  EXPECT_TRUE(of_user(desk, "bob"));
  EXPECT_FALSE(of_user(desk, "eve"));
  EXPECT_TRUE(of_user(open, "eve"));
  const auto of_object = [&](const keys::Member& member, const std::string& object) {
    return members_.is_author(prefix_of(member), {session::id_of(member.name), 0, session::id_of(object)},
                              "tactus_object_pose");
  };
  EXPECT_TRUE(of_object(museum, "vase"));
  EXPECT_FALSE(of_object(museum, "crate"));
  EXPECT_TRUE(of_object(desk, "crate")) << "an HRTC moves the objects that its users hold";
  const std::string log = audit();
  EXPECT_THAT(log, HasSubstr(R"("event":"user not permitted","subject":"hrtc lab","detail":"tactus_probe_state")"));
  EXPECT_THAT(log,
              HasSubstr(R"("event":"object not permitted","subject":"host museum","detail":"tactus_object_pose")"));
}

TEST_F(MembersTest, ARosterEntryHasTheRoleAndTheUsersOfTheKeys) {
  const keys::Member lab = add("lab", Role::kHrtc, {"ann"}), laptop = add("laptop", Role::kUser, {"ann"});
  const keys::Member screen = add("screen", Role::kObserver), museum = add("museum", Role::kHost);
  ASSERT_TRUE(admits(lab, "lab") && admits(laptop, "laptop") && admits(screen, "screen") && admits(museum, "museum"));
  const auto counts = [&](const keys::Member& member, const session::RosterEntry& entry) {
    return members_.is_author(prefix_of(member), {session::id_of(member.name), 0, 0, &entry}, "tactus_roster");
  };
  session::RosterEntry client, hrtc, host, viewer;
  host.role = session::Role::kHost;
  client.role = session::Role::kClient;
  client.users = {"ann"};
  hrtc.role = session::Role::kHrtc;
  hrtc.served_users = {{"ann", 0}};
  EXPECT_TRUE(counts(laptop, client));
  EXPECT_TRUE(counts(laptop, viewer));
  EXPECT_TRUE(counts(lab, hrtc));
  EXPECT_TRUE(counts(screen, viewer));
  EXPECT_FALSE(counts(laptop, hrtc));
  EXPECT_FALSE(counts(screen, client));
  EXPECT_TRUE(counts(museum, host));
  host.users = viewer.users = {"ann"};
  EXPECT_FALSE(counts(museum, host));
  EXPECT_FALSE(counts(screen, viewer)) << "it brings no users";
  EXPECT_TRUE(counts(laptop, viewer));
  viewer.users.clear();
  hrtc.stops = host.stops = viewer.stops = {{1, 1, 1, 0, 0}};
  host.users.clear();
  EXPECT_TRUE(counts(lab, hrtc));
  EXPECT_TRUE(counts(museum, host));
  EXPECT_FALSE(counts(laptop, viewer)) << "it forwards no stops";
  EXPECT_FALSE(counts(screen, viewer));
  client.users.emplace_back("bob");
  hrtc.served_users.push_back({"bob", 1});
  EXPECT_FALSE(counts(laptop, client));
  EXPECT_FALSE(counts(lab, hrtc));
  const std::string log = audit();
  EXPECT_THAT(log, HasSubstr(R"("event":"role not permitted","subject":"user laptop","detail":"tactus_roster")"));
  EXPECT_THAT(log, HasSubstr(R"("event":"role not permitted","subject":"observer screen","detail":"tactus_roster")"));
  EXPECT_THAT(log, HasSubstr(R"("event":"user not permitted","subject":"hrtc lab","detail":"tactus_roster")"));
}

/// Announcements that state the identity of a member, each with another GUID. Nobody proves them.
class UnprovedTest : public MembersTest {
 protected:
  /// Announces this number of participants that have not announced themselves before. Returns how many are admitted.
  std::size_t announce(std::size_t count, const char* from) {
    std::size_t admitted = 0;
    for (std::size_t i = 0; i < count; ++i) admitted += announces(participant(++announced_), from) ? 1 : 0;
    return admitted;
  }
  bool announces(const GuidPrefix& sender, const char* from) {
    return admits({announcement(sender, identity_)}, sender, from);
  }
  [[nodiscard]] GuidPrefix participant(std::uint32_t number) const {
    GuidPrefix prefix = prefix_of(museum_);
    std::memcpy(&prefix[8], &number, sizeof number);
    return prefix;
  }

  const keys::Member museum_ = add("museum", Role::kHost);
  const std::string identity_ = text_of(keys::identity_of(museum_, "museum"));
  const std::vector<Bytes> handshake_{data({0x00, 0x02, 0x01, 0xc3}, 1, for_this_program(Bytes(200)))};
  std::uint32_t announced_ = 0;
};

TEST_F(UnprovedTest, AnAddressHasFewPlacesAndTheOthersStayFree) {
  EXPECT_EQ(announce(1000, "10.0.0.7"), Members::kMaxUnprovedFromAddress);
  EXPECT_THAT(audit(), HasSubstr(R"("event":"too many programs","from":"10.0.0.7")"));
  EXPECT_TRUE(admits(add("late", Role::kHost), "late")) << "from another address";
}

TEST_F(UnprovedTest, AllAddressesTogetherLeaveMostPlacesOfTheLibraryToMembers) {
  constexpr std::size_t kPlaces = 256;  // total_participants in qos/
  std::size_t admitted = 0;
  for (const char* from : {"10.0.0.5", "10.0.0.6", "10.0.0.7"}) admitted += announce(1000, from);
  EXPECT_EQ(admitted, Members::kMaxUnproved);
  EXPECT_LE(Members::kMaxUnproved, kPlaces / 2);
}

TEST_F(UnprovedTest, PlacesAreFreeAgainAfterTwoLeasesAndLaterAfterFailedHandshakes) {
  EXPECT_EQ(announce(1000, "10.0.0.7"), Members::kMaxUnprovedFromAddress);
  for (std::uint32_t i = 1; i <= Members::kMaxUnprovedFromAddress / 2; ++i)
    members_.on_authentication(participant(i), false);
  pass(3s);  // two leases of 1 s, and to the next search
  EXPECT_EQ(announce(1000, "10.0.0.7"), Members::kMaxUnprovedFromAddress / 2);
  pass(Members::kMaxUnprovedTime);
  EXPECT_EQ(announce(1000, "10.0.0.7"), Members::kMaxUnprovedFromAddress);
}

TEST_F(UnprovedTest, HandshakesForOtherParticipantsDoNotCount) {
  ASSERT_EQ(announce(1, "10.0.0.7"), 1u);
  const std::vector<Bytes> of_other{data({0x00, 0x02, 0x01, 0xc3}, 1, Bytes(200))};
  for (int i = 0; i < 1000; ++i) EXPECT_TRUE(admits(of_other, participant(1))) << "the library ignores it";
  EXPECT_TRUE(admits(handshake_, participant(1)));
}

TEST_F(UnprovedTest, AParticipantThatHasAnnouncedNothingForItsLeaseCannotStayInTheLibrary) {
  ASSERT_EQ(announce(1, "10.0.0.7"), 1u);
  pass(1s);  // its lease
  EXPECT_TRUE(admits({kInfoTime}, participant(1)));
  pass(1ms);
  EXPECT_FALSE(admits({kInfoTime}, participant(1)));
}

TEST_F(UnprovedTest, TheLibraryReadsFewHandshakesOfAParticipant) {
  ASSERT_EQ(announce(2, "10.0.0.7"), 2u);
  const std::vector<Bytes> two{handshake_[0], handshake_[0]};
  std::uint32_t admitted = 0;
  for (int i = 0; i < 1000; ++i) admitted += admits(two, participant(1), "10.0.0.7") ? 2 : 0;
  EXPECT_EQ(admitted, Members::kMaxHandshakeBurst);
  EXPECT_THAT(audit(), HasSubstr(R"("event":"too many handshakes","from":"10.0.0.7")"));
  EXPECT_TRUE(admits({kInfoTime}, participant(1))) << "another message of this participant";
  EXPECT_TRUE(admits(handshake_, participant(2))) << "of another participant";
  pass(1000ms / Members::kMaxHandshakeRate);
  EXPECT_TRUE(admits(handshake_, participant(1)));
  EXPECT_FALSE(admits(handshake_, participant(1)));
}

TEST_F(UnprovedTest, TheLibraryReadsNoHandshakesOfAParticipantThatHasFailed) {
  ASSERT_EQ(announce(2, "10.0.0.7"), 2u);
  for (int i = 0; i < Members::kMaxFailedHandshakes; ++i) {
    EXPECT_TRUE(admits(handshake_, participant(1)));
    members_.on_authentication(participant(1), false);
  }
  for (int i = 0; i < 20; ++i) {
    pass(1s);
    ASSERT_TRUE(announces(participant(1), "10.0.0.7"));
    EXPECT_FALSE(admits(handshake_, participant(1)));
  }
  ASSERT_TRUE(announces(participant(2), "10.0.0.7"));
  EXPECT_TRUE(admits(handshake_, participant(2))) << "of another participant";
}

TEST_F(UnprovedTest, TheLibraryReadsFewHandshakesOfAllParticipantsThatDoNotProveTheirIdentity) {
  constexpr std::uint32_t kSeconds = 10;
  const auto read_from = [&](const std::vector<const char*>& addresses) {
    std::uint32_t admitted = 0;
    std::vector<std::pair<GuidPrefix, const char*>> senders;
    for (std::uint32_t second = 0; second < kSeconds; ++second, pass(1s)) {
      for (const auto& [sender, from] : senders) EXPECT_TRUE(announces(sender, from));
      for (const char* const from : addresses)
        for (std::size_t i = 0; i < Members::kMaxUnprovedFromAddress; ++i)
          if (announces(participant(++announced_), from)) senders.emplace_back(participant(announced_), from);
      for (const auto& [sender, from] : senders)
        for (std::uint32_t i = 0; i <= Members::kMaxHandshakeBurst; ++i)
          admitted += admits(handshake_, sender, from) ? 1 : 0;
    }
    return admitted;
  };
  const std::uint32_t of_two = read_from({"10.0.0.5", "10.0.0.6"});
  EXPECT_GE(of_two, Members::kMaxUnprovedBurst);
  EXPECT_LE(of_two, Members::kMaxUnprovedBurst + kSeconds * Members::kMaxUnprovedRate);
  pass(1h);
  const std::uint32_t of_one = read_from({"10.0.0.7"});
  EXPECT_GE(of_one, Members::kMaxUnprovedBurstOfAddress);
  EXPECT_LE(of_one, Members::kMaxUnprovedBurstOfAddress + kSeconds * Members::kMaxUnprovedRateOfAddress);
}

TEST_F(UnprovedTest, HandshakesOfParticipantsThatProveTheirIdentityAreNotLimitedTogether) {
  constexpr std::uint32_t kJoining = 600;
  static_assert(4 * kJoining > Members::kMaxUnprovedBurst);
  for (std::uint32_t i = 1; i <= kJoining; ++i) {
    ASSERT_EQ(announce(1, "10.0.0.7"), 1u) << i;
    for (int k = 0; k < 4; ++k) ASSERT_TRUE(admits(handshake_, participant(i))) << i;
    members_.on_authentication(participant(i), true);
  }
}

TEST_F(UnprovedTest, AParticipantThatIsGoneHasToProveItsIdentityAgain) {
  constexpr std::uint32_t kEnded = 100;
  for (std::uint32_t i = 1; i <= kEnded; ++i) {
    ASSERT_EQ(announce(1, "10.0.0.7"), 1u);
    members_.on_authentication(participant(i), true);
    members_.on_gone(participant(i));
    EXPECT_FALSE(admits({kInfoTime}, participant(i)));
    EXPECT_THAT(members_.ids_of(participant(i)), testing::IsEmpty());
  }
  std::size_t admitted = 0;  // of their announcements, which someone repeats
  for (std::uint32_t i = 1; i <= kEnded; ++i) admitted += announces(participant(i), "10.0.0.7") ? 1 : 0;
  EXPECT_EQ(admitted, Members::kMaxUnprovedFromAddress);
  members_.on_gone(participant(1));
  EXPECT_EQ(announce(1, "10.0.0.7"), 0u) << "the end of one that has not proved its identity frees no place at once";
}

TEST_F(UnprovedTest, ACutOffMemberIsNotForgotten) {
  const keys::Member ann = add("ann", Role::kUser);
  ASSERT_TRUE(admits(ann, "ann"));
  const auto send_false_sample = [&] { EXPECT_FALSE(members_.is_author(prefix_of(ann), {7}, "tactus_roster")); };
  for (std::uint32_t i = 0; i < Members::kMaxRefused; ++i) send_false_sample();
  pass(Members::kRefusedWindow + 1s);
  send_false_sample();  // one that the library had already received
  pass(1h);
  EXPECT_EQ(announce(1000, "10.0.0.7"), Members::kMaxUnprovedFromAddress) << "it makes room";
  EXPECT_FALSE(admits(ann, "ann"));
}

TEST_F(UnprovedTest, ALongLeaseIsRefused) {
  const GuidPrefix sender = prefix_of(museum_);
  for (const std::uint32_t lease_s : {30u, 100u, 0x7fffffffu, 0xffffffffu})
    EXPECT_FALSE(admits({announcement(sender, identity_, lease_s)}, sender)) << lease_s;
  EXPECT_TRUE(admits({announcement(sender, identity_, 29)}, sender));
}

TEST_F(UnprovedTest, AFloodRemovesNoMember) {
  ASSERT_TRUE(admits(museum_, "museum"));
  for (const char* from : {"10.0.0.5", "10.0.0.6", "10.0.0.7", "10.0.0.9"}) (void)announce(1000, from);
  EXPECT_TRUE(admits({kInfoTime}, prefix_of(museum_)));
}

TEST_F(MembersTest, RecordsAtMost4096Participants) {
  const std::string museum = text_of(keys::identity_of(add("museum", Role::kHost), "museum"));
  GuidPrefix sender = prefix_of(*authority_.find("museum"));
  const auto join = [&](std::size_t i) {
    std::memcpy(&sender[8], &i, 4);
    const bool is_admitted = admits({announcement(sender, museum)}, sender);
    members_.on_authentication(sender, true);
    return is_admitted;
  };
  for (std::size_t i = 0; i < 4096; ++i) ASSERT_TRUE(join(i)) << i;
  EXPECT_FALSE(join(4096));
  EXPECT_TRUE(join(7)) << "one that is recorded";
  EXPECT_THAT(audit(), HasSubstr(R"("event":"too many programs")"));
}

TEST_F(MembersTest, AMemberWithTooManyRefusedSamplesIsCutOff) {
  const keys::Member ann = add("ann", Role::kUser);
  ASSERT_TRUE(admits(ann, "ann"));
  for (std::uint32_t i = 0; i < Members::kMaxRefused; ++i) {
    EXPECT_TRUE(admits({kInfoTime}, prefix_of(ann)));
    EXPECT_FALSE(members_.is_author(prefix_of(ann), {7}, "tactus_roster"));
  }
  EXPECT_FALSE(admits({kInfoTime}, prefix_of(ann)));
  EXPECT_FALSE(admits(ann, "ann"));
  EXPECT_FALSE(members_.is_author(prefix_of(ann), {session::id_of("ann")}, "tactus_roster"));
}

TEST_F(MembersTest, AMemberWithTooManyInvalidSamplesIsCutOff) {
  const keys::Member ann = add("ann", Role::kUser);
  ASSERT_TRUE(admits(ann, "ann"));
  for (std::uint32_t i = 0; i < Members::kMaxRefused; ++i) {
    EXPECT_TRUE(admits({kInfoTime}, prefix_of(ann)));
    members_.report_invalid(prefix_of(ann), "tactus_intent", "path: expected ascending times");
  }
  EXPECT_THAT(audit(), HasSubstr(R"("event":"invalid sample","subject":"user ann",)"
                                 R"("detail":"tactus_intent, path: expected ascending times")"));
  EXPECT_FALSE(admits({kInfoTime}, prefix_of(ann)));
}

TEST_F(MembersTest, AnInvalidSampleOfAnUnknownParticipantIsNobodys) {
  members_.report_invalid(prefix_of(add("ann", Role::kUser)), "tactus_intent", "path: expected ascending times");
  EXPECT_THAT(audit(), testing::Not(HasSubstr("invalid sample")));
}

TEST_F(MembersTest, RevokedAndExpiredMembersAreCutOffDuringTheSession) {
  const keys::Member museum = add("museum", Role::kHost), ann = add("ann", Role::kUser);
  ASSERT_TRUE(admits(museum, "museum"));
  ASSERT_TRUE(admits(ann, "ann"));
  EXPECT_TRUE(members_.check_again(now_).empty());
  authority_.revoke("museum");
  EXPECT_THAT(members_.check_again(now_), testing::ElementsAre(HasSubstr("read a new list: 1 revoked key, list of"),
                                                               HasSubstr("the keys of host museum are revoked")));
  EXPECT_FALSE(admits({kInfoTime}, prefix_of(museum)));
  EXPECT_THAT(audit(), HasSubstr("\"subject\":\"host museum\",\"detail\":\"revoked, serial number " + museum.serial));
  EXPECT_TRUE(admits({kInfoTime}, prefix_of(ann)));
  EXPECT_THAT(members_.check_again(ann.valid_until + 1),
              testing::ElementsAre(HasSubstr("the keys of user ann have expired on"),
                                   HasSubstr("tactus keys add-hrtc lab-keys desk --replace")));
  EXPECT_FALSE(admits({kInfoTime}, prefix_of(ann)));
}

TEST_F(MembersTest, AReplacementIsAdmittedAndItsPredecessorIsNot) {
  const keys::Member lost = add("ann", Role::kUser);
  const keys::Member replacement = replace("ann", Role::kUser);
  EXPECT_THAT(members_.check_again(now_), testing::ElementsAre(HasSubstr("read a new list")));
  EXPECT_FALSE(admits(lost, "ann"));
  EXPECT_TRUE(admits(replacement, "ann"));
}

TEST_F(MembersTest, AListThatCannotBeReadDoesNotEndTheEarlierOne) {
  const keys::Member museum = add("museum", Role::kHost);
  authority_.revoke("museum");
  ASSERT_THAT(members_.check_again(now_), testing::ElementsAre(HasSubstr("read a new list")));
  test_support::write_bytes(authority_.folder_of("desk") / keys::files::kRevoked, "damaged");
  EXPECT_THAT(members_.check_again(now_), testing::ElementsAre(HasSubstr("the earlier list stays in force")));
  EXPECT_FALSE(admits(museum, "museum"));
}

TEST_F(MembersTest, NoListMakesRevokedKeysValidAgain) {
  const keys::Member museum = add("museum", Role::kHost);
  authority_.revoke("museum");
  ASSERT_EQ(members_.check_again(now_).size(), 1u);
  EXPECT_THAT(after_list_of(now_ - 60), testing::ElementsAre(HasSubstr("which stays in force")));
  EXPECT_FALSE(admits(museum, "museum"));
  // The owner has restored the authority from a backup, and revoked other keys since.
  EXPECT_THAT(
      after_list_of(now_ + 60),
      testing::ElementsAre(HasSubstr("read a new list: 0 revoked keys"),
                           HasSubstr("revoked.pem: found a list without 1 key that the earlier one revokes; was "
                                     "the authority restored from a backup? revoke it again: " +
                                     museum.serial)));
  EXPECT_FALSE(admits(museum, "museum"));
  EXPECT_EQ(members_.list_made(), now_ + 60);
  EXPECT_THAT(members_.check_again(now_), testing::IsEmpty()) << "one message for each list";
}

TEST_F(MembersTest, FewKeysThatOnlyEarlierListsRevokeAreStored) {
  std::vector<std::string> serials;
  for (std::size_t i = 0; i <= Members::kMaxEarlierRevoked; ++i) serials.push_back(std::to_string(100'000 + i));
  ASSERT_THAT(after_list_of(now_ + 60, serials),
              testing::ElementsAre(HasSubstr("read a new list: 10001 revoked keys")));
  EXPECT_THAT(after_list_of(now_ + 120),
              testing::ElementsAre(HasSubstr("read a new list"), HasSubstr("without 10001 keys that the earlier one")));
  EXPECT_THAT(after_list_of(now_ + 180),
              testing::ElementsAre(HasSubstr("read a new list"), HasSubstr("without 10000 keys that the earlier one")));
}

TEST_F(MembersTest, AMemberWithAnotherListOfRevokedKeysIsNamed) {
  const keys::Member museum = add("museum", Role::kHost);
  ASSERT_TRUE(admits(museum, "museum"));
  const std::time_t own = members_.list_made();
  const auto messages_after = [&](std::time_t made, int earlier_checks = 0) {
    session::RosterEntry entry;
    entry.name = "museum";
    entry.session = "lab";
    entry.origin = {session::id_of(entry.session), session::id_of(entry.name), 1, 0};
    entry.role = session::Role::kHost;
    entry.revoked_made_s = made;
    EXPECT_TRUE(members_.is_author(prefix_of(museum), {session::id_of("museum"), 0, 0, &entry}, "tactus_roster"));
    std::vector<std::string> messages;
    for (int check = 0; check < 6; ++check)
      for (std::string& message : members_.check_again(now_)) {
        EXPECT_TRUE(earlier_checks + check >= 2 || message.find("newer one") == std::string::npos)
            << "the list may just be copied";
        messages.push_back(std::move(message));
      }
    return messages;
  };
  EXPECT_THAT(messages_after(own), testing::IsEmpty());
  EXPECT_THAT(messages_after(own + 60),
              testing::ElementsAre(testing::ContainsRegex("desk: found the list of .*; host museum has a newer one")));
  EXPECT_THAT(messages_after(own + 120), testing::IsEmpty()) << "a member can state any time";
  EXPECT_THAT(messages_after(INT64_MAX), testing::IsEmpty()) << "no date";
  EXPECT_THAT(after_list_of(own + 60), testing::ElementsAre(HasSubstr("read a new list: 0 revoked keys")));
  EXPECT_EQ(members_.list_made(), own + 60) << "also with the same keys";
  EXPECT_THAT(
      messages_after(own, 1),
      testing::ElementsAre(testing::ContainsRegex("host museum uses the list of .*; this program has a newer")));
}

TEST(AuditLogTest, EqualEventsAreOneLineAndManyDifferentOnesAreCounted) {
  const test_support::TemporaryFolder folder;
  AuditLog log{folder.path() / "audit.jsonl", "lab", "desk"};
  for (int i = 0; i < 3; ++i) log.add({"plain message", "", "10.0.0.9", ""});
  for (std::size_t i = 0; i < AuditLog::kMaxEvents + 9; ++i) log.add({"plain message", "", std::to_string(i), ""});
  ASSERT_EQ(log.write(0), "");
  ASSERT_EQ(log.write(0), "");
  const std::string text = test_support::read_bytes(folder.path() / "audit.jsonl");
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), static_cast<std::ptrdiff_t>(AuditLog::kMaxEvents) + 1);
  EXPECT_THAT(text, HasSubstr(R"("from":"10.0.0.9","count":3)"));
  EXPECT_THAT(text, HasSubstr(R"("event":"further events","count":10)"));
  AuditLog without_folder{folder.path() / "absent/audit.jsonl", "lab", "desk"};
  without_folder.add({"started", "hrtc desk", "", ""});
  EXPECT_THAT(without_folder.write(0), HasSubstr("audit.jsonl: No such file"));
}

TEST(AuditLogTest, EventsThatCannotBeWrittenAreWrittenLater) {
  const test_support::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "audit.jsonl";
  AuditLog log{file, "lab", "desk"};
  log.add({"started", "hrtc desk", "", ""});
  ASSERT_EQ(log.write(0), "");
  const std::string before = test_support::read_bytes(file);
  {
    const test_support::FileSizeLimit full_disk{before.size() + 10};
    for (int i = 0; i < 3; ++i) log.add({"plain message", "", "10.0.0.9", ""});
    EXPECT_THAT(log.write(1), HasSubstr("audit.jsonl: "));
    EXPECT_EQ(test_support::read_bytes(file), before) << "no part of a line";
    EXPECT_THAT(log.write(2, true), HasSubstr("audit.jsonl: "));
  }
  EXPECT_EQ(log.write(3), "");
  EXPECT_THAT(test_support::read_bytes(file).substr(before.size()),
              AllOf(testing::StartsWith("{"), HasSubstr(R"("from":"10.0.0.9","count":3)")));
}

TEST(AuditLogTest, OnlyTheOwnerCanReadAFileThatOthersCouldReadBefore) {
  const test_support::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "audit.jsonl", earlier = folder.path() / "audit.jsonl.1";
  const auto permissions_after_write = [&] {
    std::filesystem::permissions(file, std::filesystem::perms{0644});
    AuditLog log{file, "lab", "desk"};
    log.add({"started", "hrtc desk", "", ""});
    EXPECT_EQ(log.write(0), "");
    return std::filesystem::status(file).permissions();
  };
  constexpr std::filesystem::perms kPrivate{0600};
  test_support::write_bytes(file, "{}\n");
  EXPECT_EQ(permissions_after_write(), kPrivate);
  EXPECT_FALSE(std::filesystem::exists(earlier));
  std::filesystem::resize_file(file, AuditLog::kMaxBytes + 1);
  EXPECT_EQ(permissions_after_write(), kPrivate);
  EXPECT_EQ(std::filesystem::status(earlier).permissions(), kPrivate);
  EXPECT_THAT(test_support::read_bytes(file), testing::StartsWith("{")) << "a new file";
}

TEST(AuditLogTest, ARepeatedEventIsWrittenEveryMinuteAndAtTheEnd) {
  constexpr std::int64_t kSecond = 1'000'000'000;
  const test_support::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "audit.jsonl";
  AuditLog log{file, "lab", "desk"};
  const auto lines_within = [&](std::int64_t begin_s, std::int64_t end_s) {
    test_support::write_bytes(file, "");
    for (std::int64_t at = 10 * begin_s; at < 10 * end_s; ++at) {  // tenths of a second
      log.add({"unknown program", "", "10.0.0.9", ""});
      EXPECT_EQ(log.write(at * kSecond / 10), "");
    }
    const std::string text = test_support::read_bytes(file);
    return std::count(text.begin(), text.end(), '\n');
  };
  EXPECT_EQ(lines_within(0, 60), 6) << "after 0, 1, 3, 7, 15 and 31 s";
  EXPECT_EQ(lines_within(60, 660), 10);
  EXPECT_EQ(log.write(800 * kSecond), "") << "after a pause";
  EXPECT_EQ(log.write(930 * kSecond), "");
  EXPECT_EQ(lines_within(1000, 1003), 2) << "it is a new event";
  test_support::write_bytes(file, "");
  EXPECT_EQ(log.write(1003 * kSecond, true), "");
  EXPECT_THAT(test_support::read_bytes(file), HasSubstr("\"count\":")) << "the rest, at the end of the program";
  test_support::write_bytes(file, "");
  for (std::int64_t at = 2000; at < 2600; at += 3) {  // a program without keys announces itself every 3 s
    log.add({"unknown program", "", "10.0.0.8", ""});
    EXPECT_EQ(log.write(at * kSecond), "");
  }
  const std::string text = test_support::read_bytes(file);
  EXPECT_LT(std::count(text.begin(), text.end(), '\n'), 20);
}

TEST(AuditLogTest, AFullFileIsSetAsideAndOnlyItsOwnerCanReadIt) {
  const test_support::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "audit.jsonl";
  AuditLog log{file, "lab", "desk"};
  log.add({"started", "hrtc desk", "", ""});
  ASSERT_EQ(log.write(0), "");
  EXPECT_EQ(std::filesystem::status(file).permissions() & std::filesystem::perms::all,
            std::filesystem::perms::owner_read | std::filesystem::perms::owner_write);
  test_support::write_bytes(file, std::string(AuditLog::kMaxBytes + 1, 'x'));
  log.add({"joined", "user \xff", "", ""});
  ASSERT_EQ(log.write(0), "");
  EXPECT_EQ(std::filesystem::file_size(file.string() + ".1"), AuditLog::kMaxBytes + 1);
  EXPECT_LT(std::filesystem::file_size(file), 300u);
}

}  // namespace
}  // namespace tactus::wire
