/// Sessions in which only members of an authority take part, with all messages encrypted.
#include <fstream>

#include "keys/authority.hpp"
#include "tests/e2e/session_test.hpp"

namespace tactus::e2e {
namespace {

using keys::Role;
using Seen = Observer::Seen;
using testing::HasSubstr;

class SecuredTest : public SessionTest {
 protected:
  [[nodiscard]] std::string keys_of(const std::string& name, Role role, keys::Permitted permitted = {}) const {
    keys::NewMember member;
    member.name = name;
    member.role = role;
    member.permitted = std::move(permitted);
    return authority_.add(member).string();
  }
  [[nodiscard]] std::vector<std::string> with_keys(std::vector<std::string> command, const std::string& folder) const {
    command.insert(command.end(), {"--keys", folder, "--audit", audit_of(std::filesystem::path{folder}.filename())});
    return command;
  }
  [[nodiscard]] std::string audit_of(const std::string& member) const { return path(member + ".jsonl"); }
  [[nodiscard]] static std::vector<std::string> in_zone(const std::string& zone, std::vector<std::string> command) {
    command.insert(command.begin(), {"/usr/bin/env", "TZ=" + zone});
    return command;
  }
  [[nodiscard]] wire::SessionAddress observer_address(const std::string& folder) const {
    wire::SessionAddress made = address("observer");
    made.naming = wire::Naming::kInstance;
    made.keys = folder;
    made.audit = audit_of("observer");
    return made;
  }

  keys::Authority authority_ = keys::Authority::create(path("lab-keys"));
};

TEST_F(SecuredTest, OnlyMembersTakePart) {
  Observer observer{observer_address(keys_of("observer", Role::kObserver))};
  const keys::Authority other = keys::Authority::create(path("other-keys"));
  keys::NewMember foreign;
  foreign.name = "foreign";
  foreign.role = Role::kOperator;
  Observer without{address("plain")};
  Observer stranger{observer_address(other.add(foreign))};
  // On machines in two time zones, because Fast DDS reads permissions as local times.
  Process museum{in_zone("NZST-12", with_keys(host("museum", models().sphere), keys_of("museum", Role::kHost)))};
  Process desk{in_zone("PST8", with_keys(hrtc("desk"), keys_of("desk", Role::kHrtc)))};
  Process users{with_keys(in_session("sim", {"--scenario", "touch", "--seconds", "4"}),
                          keys_of("sim", Role::kOperator, {"ann"}))};
  EXPECT_TRUE(exits_with(0, users)) << users.output() << desk.output() << museum.output();
  // A busy machine may deliver the first region after the first contact; without regions no contact would be exact.
  EXPECT_THAT(users.output(), testing::ContainsRegex("ann +desk +[0-9.]+ +[0-9.]+ +[0-9.]+ +(9[0-9]|100)\\.[0-9]+ "));
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_TRUE(exits_with(0, museum));
  EXPECT_GT(observer.seen().user("ann").exact, 0u);
  EXPECT_EQ(observer.seen().roster["desk"].revoked_made_s, authority_.revoked().made) << "others compare the lists";
  for (Observer* outside : {&without, &stranger}) {
    EXPECT_EQ(outside->seen().user("ann").count, 0u);
    EXPECT_FALSE(outside->seen().has_left("desk"));
  }
  for (const char* member : {"museum", "desk"}) {
    const std::string log = test_support::read_bytes(audit_of(member));
    EXPECT_THAT(log, testing::ContainsRegex(R"("event":"unknown program","from":"[0-9.]+","count")")) << "without keys";
    EXPECT_THAT(log, testing::ContainsRegex(
                         R"("event":"unknown program","from":"[0-9.]+","detail":"states to be operator foreign")"));
  }
}

TEST_F(SecuredTest, TheKeysOfAUserPermitNeitherAResetNorAnotherUser) {
  const std::string laptop = keys_of("laptop", Role::kUser, {"ann"});
  Process reset{with_keys(in_session("control", {"reset"}), laptop)};
  EXPECT_TRUE(exits_with(2, reset));
  EXPECT_THAT(reset.output(), HasSubstr("topic tactus_reset: the keys of user 'laptop' do not permit to write it; "
                                        "make keys with tactus keys add-operator"));
  wire::Participants participants{observer_address(laptop)};
  const wire::EndpointOptions ann{wire::user_partition("ann")}, bob{wire::user_partition("bob")};
  EXPECT_NO_THROW((wire::Writer<session::Intent>{participants, wire::topics::kIntent, ann}));
  try {
    const wire::Writer<session::Intent> intent{participants, wire::topics::kIntent, bob};
    FAIL() << "moves the hand of another user";
  } catch (const wire::WireError& error) {
    EXPECT_THAT(error.what(), HasSubstr("user 'bob': the keys of user 'laptop' permit only ann"));
  }
}

TEST_F(SecuredTest, AnHrtcServesAndAHostOffersOnlyWhatTheirKeysName) {
  Process false_host{with_keys(host("other", models().sphere), keys_of("other", Role::kHost, {"vase"}))};
  EXPECT_TRUE(exits_with(2, false_host));
  EXPECT_THAT(false_host.output(), HasSubstr("object 'sphere': the keys of host 'other' permit only vase"));
  Process museum{with_keys(host("museum", models().sphere), keys_of("museum", Role::kHost, {"vase", "sphere"}))};
  Process desk{with_keys(hrtc("desk"), keys_of("desk", Role::kHrtc, {"bob"}))};
  Process users{with_keys(in_session("sim", {"--scenario", "touch", "--seconds", "60"}),
                          keys_of("sim", Role::kOperator, {"ann"}))};
  EXPECT_TRUE(desk.wait_for_line("user ann of client sim refused: the keys of this HRTC do not permit"))
      << desk.output() << users.output();
  desk.signal(SIGINT);
  EXPECT_TRUE(exits_with(0, desk));
  EXPECT_THAT(test_support::read_bytes(audit_of("desk")),
              HasSubstr(R"("event":"user not served","subject":"operator sim","detail":"ann")"));
}

TEST_F(SecuredTest, AnEmptyNameOfTheFolderDoesNotMeanNoKeys) {
  Process desk{in_session("hrtc", {"--keys", ""})};
  EXPECT_TRUE(exits_with(2, desk));
  EXPECT_THAT(desk.output(), HasSubstr("--keys: found no name, expected a folder of tactus keys"));
}

TEST_F(SecuredTest, NewKeysKeepTheNamesOfTheEarlierOnes) {
  const auto keys = [&](std::vector<std::string> arguments) {
    Process process{program("keys", std::move(arguments))};
    EXPECT_TRUE(exits_with(0, process)) << process.output();
    return process.output();
  };
  const std::string lab = path("lab-keys");
  keys({"add-hrtc", lab, "desk", "ann", "bob"});
  EXPECT_THAT(keys({"add-hrtc", lab, "desk", "--replace"}), HasSubstr("The earlier keys of desk are revoked"));
  EXPECT_THAT(keys({"show", lab}), testing::ContainsRegex("desk +hrtc +[0-9-]+ +valid +ann bob"));
  keys({"add-hrtc", lab, "desk", "eve", "--replace"});
  EXPECT_THAT(keys({"show", lab}), testing::ContainsRegex("desk +hrtc +[0-9-]+ +valid +eve"));
  keys({"add-hrtc", lab, "desk", "--replace", "--all"});
  keys({"add-user", lab, "laptop"});
  const std::string members = keys({"show", lab});
  EXPECT_THAT(members, testing::ContainsRegex("desk +hrtc +[0-9-]+ +valid +all users"));
  EXPECT_THAT(members, testing::ContainsRegex("laptop +user +[0-9-]+ +valid +laptop"));
}

TEST_F(SecuredTest, KeysWhoseNamesAreUnknownAreNotReplacedByKeysForAll) {
  const std::string lab = path("lab-keys");
  (void)keys_of("museum", Role::kHost);
  const std::filesystem::path certificate =
      std::filesystem::path{keys_of("desk", Role::kHrtc, {"ann"})} / keys::files::kCertificate;
  const auto keys = [&](std::vector<std::string> arguments, int status) {
    Process process{program("keys", std::move(arguments))};
    EXPECT_TRUE(exits_with(status, process));
    return process.output();
  };
  std::ofstream{certificate} << "damaged";
  const std::string members = keys({"show", lab}, 2);
  EXPECT_THAT(members, testing::ContainsRegex("desk +[?] +[?] +damaged"));
  EXPECT_THAT(members, testing::ContainsRegex("museum +host +[0-9-]+ +valid"));
  EXPECT_THAT(keys({"add-hrtc", lab, "desk", "--replace"}, 2), HasSubstr("expected names or --all"));
  EXPECT_THAT(keys({"add-hrtc", lab, "desk", "ann", "--replace"}, 2), HasSubstr("remove the file"));
  std::filesystem::remove(certificate);
  EXPECT_THAT(keys({"add-hrtc", lab, "desk", "--replace"}, 2), HasSubstr("expected names or --all"));
  EXPECT_THAT(keys({"add-hrtc", lab, "desk", "ann", "--replace"}, 0),
              HasSubstr("earlier keys of desk are not revoked"));
  EXPECT_THAT(keys({"show", lab}, 0), testing::ContainsRegex("desk +hrtc +[0-9-]+ +valid +ann"));
}

TEST_F(SecuredTest, AWrongNameOrRoleReplacesNoKeys) {
  const std::string lab = path("lab-keys");
  (void)keys_of("museum", Role::kHost);
  const auto error_of = [&](std::vector<std::string> arguments) {
    Process process{program("keys", std::move(arguments))};
    EXPECT_TRUE(exits_with(2, process));
    return process.output();
  };
  EXPECT_THAT(error_of({"add-hrtc", lab, "museum", "--replace"}), HasSubstr("expected add-host or another name"));
  EXPECT_THAT(error_of({"add-hrtc", lab, "museum"}), HasSubstr("has the keys of role host"));
  EXPECT_THAT(error_of({"add-hrtc", lab, "musuem", "--replace"}), HasSubstr("found no member 'musuem'"));
  EXPECT_THAT(error_of({"add-hrtc", lab, "desk", "--days", "abc"}),
              testing::AllOf(HasSubstr("--days"), HasSubstr("3650")));
  EXPECT_FALSE(authority_.find("museum")->is_revoked);
  authority_.revoke("museum");
  EXPECT_THAT(error_of({"export", lab, "museum", path("museum-keys")}), HasSubstr("is revoked"));
  Process changed{program("keys", {"add-hrtc", lab, "museum", "--replace"})};
  EXPECT_TRUE(exits_with(0, changed)) << changed.output();
}

TEST_F(SecuredTest, RevokedKeysAreRefusedByTheMemberAndByOthers) {
  const std::string lost = keys_of("lost", Role::kOperator, {"ann"}), copy = path("copy");
  std::filesystem::copy(lost, copy);
  Observer observer{observer_address(keys_of("observer", Role::kObserver))};
  authority_.revoke("lost");
  Process refused{with_keys(hrtc("desk"), lost)};
  EXPECT_TRUE(exits_with(2, refused));
  EXPECT_THAT(refused.output(), HasSubstr("the certificate of operator 'lost' is revoked"));
  // The thief keeps the old list. The host has the new one.
  Process museum{with_keys(host("museum", models().sphere), keys_of("museum", Role::kHost))};
  Observer thief{observer_address(copy)};
  ASSERT_TRUE(observer.until([](const Seen& seen) { return seen.is_present("museum"); })) << museum.output();
  std::this_thread::sleep_for(std::chrono::seconds{1});  // a match would come within 0.1 s
  EXPECT_FALSE(thief.seen().is_present("museum"));
}

TEST_F(SecuredTest, ADiscoveryServerIsRefusedWithTheReason) {
  Process desk{with_keys(in_session("hrtc", {"--discovery-server", "127.0.0.1"}), keys_of("desk", Role::kHrtc))};
  EXPECT_TRUE(exits_with(2, desk));
  EXPECT_THAT(desk.output(), HasSubstr("--discovery-server cannot be used with --keys"));
}

}  // namespace
}  // namespace tactus::e2e
