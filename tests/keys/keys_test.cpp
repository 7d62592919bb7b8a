#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <filesystem>
#include <functional>
#include <iterator>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "keys/authority.hpp"
#include "keys/documents.hpp"
#include "tests/support/temporary_folder.hpp"

namespace tactus::keys {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

constexpr std::time_t kDay = 24 * 3600;

std::string error_of(const std::function<void()>& action) {
  try {
    action();
  } catch (const KeyError& error) {
    return error.what();
  }
  return "";
}

/// From now on, renameat2() fails in this thread as on a file system that cannot exchange files.
void refuse_exchanges() {
  constexpr std::uint32_t kLoad = BPF_LD | BPF_W | BPF_ABS, kEqual = BPF_JMP | BPF_JEQ | BPF_K;
  std::array<sock_filter, 4> filter{{BPF_STMT(kLoad, offsetof(seccomp_data, nr)), BPF_JUMP(kEqual, SYS_renameat2, 0, 1),
                                     BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EINVAL),
                                     BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW)}};
  const sock_fprog program{filter.size(), filter.data()};
  ASSERT_EQ(::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0), 0);
  ASSERT_EQ(::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program), 0);
}

class KeysTest : public testing::Test {
 protected:
  /// Returns the reason for which a program with these keys does not start.
  static std::string error_of_member(const fs::path& folder, std::time_t now = std::time(nullptr)) {
    return error_of([&] { (void)read_member(folder, now); });
  }
  [[nodiscard]] static NewMember hrtc(const std::string& name) {
    NewMember member;
    member.name = name;
    member.role = Role::kHrtc;
    return member;
  }

  test_support::TemporaryFolder folder_;
  Authority authority_ = Authority::create(folder_.path() / "lab-keys");
};

TEST_F(KeysTest, AMemberHasNameRoleAndTheTimeForWhichItIsValid) {
  NewMember added = hrtc("desk");
  added.days = 30;
  const std::time_t now = std::time(nullptr);
  const Member member = read_member(authority_.add(added), now);
  EXPECT_EQ(member.name, "desk");
  EXPECT_EQ(member.role, Role::kHrtc);
  EXPECT_EQ(member.group, "lab-keys");
  EXPECT_NEAR(static_cast<double>(member.valid_until - now), 30.0 * kDay, 60);
  EXPECT_FALSE(member.is_revoked);
}

TEST_F(KeysTest, ACertificateStatesThePermittedNames) {
  const auto permitted_of = [&](const NewMember& added) {
    return read_member(authority_.add(added), std::time(nullptr)).permitted;
  };
  NewMember desk = hrtc("desk"), sim;
  EXPECT_EQ(permitted_of(desk), Permitted{}) << "all users";
  desk.replaces = true;
  desk.permitted = {"ann", "bob.2"};
  EXPECT_EQ(permitted_of(desk), (Permitted{"ann", "bob.2"}));
  sim.name = "sim";
  sim.role = Role::kOperator;
  EXPECT_EQ(permitted_of(sim), Permitted{"sim"});
}

TEST_F(KeysTest, OnlyTheOwnerCanReadWhatIsMade) {
  (void)authority_.add(hrtc("desk"));
  for (const auto& entry : fs::recursive_directory_iterator{folder_.path() / "lab-keys"}) {
    struct stat status {};
    ASSERT_EQ(::stat(entry.path().c_str(), &status), 0);
    if (!entry.is_regular_file()) continue;
    EXPECT_EQ(status.st_mode & 0077, 0u) << entry.path();
  }
}

TEST_F(KeysTest, KeysAreRefusedOutsideTheirTime) {
  const fs::path desk = authority_.add(hrtc("desk"));
  const std::time_t now = std::time(nullptr);
  EXPECT_EQ(error_of_member(desk, now + 364 * kDay), "");
  EXPECT_THAT(error_of_member(desk, now + 366 * kDay),
              AllOf(HasSubstr("has expired on"), HasSubstr("tactus keys add-hrtc lab-keys desk --replace")));
  EXPECT_THAT(error_of_member(desk, now - kDay), HasSubstr("is the clock of this machine right?"));
}

TEST_F(KeysTest, RevokedKeysAreRefusedAndOthersAreNot) {
  const fs::path desk = authority_.add(hrtc("desk")), lab = authority_.add(hrtc("lab"));
  authority_.revoke("desk");
  EXPECT_THAT(error_of_member(desk), HasSubstr("the certificate of hrtc 'desk' is revoked"));
  EXPECT_EQ(error_of_member(lab), "");
  authority_.revoke("desk");
  EXPECT_THAT(error_of_member(authority_.add(hrtc("late"))), "") << "a later member has the list too";
  EXPECT_EQ(authority_.revoked().serials, std::vector<std::string>{authority_.find("desk")->serial});
  EXPECT_NEAR(static_cast<double>(authority_.revoked().made - std::time(nullptr)), 0, 60);
  EXPECT_EQ(authority_.names(), (std::vector<std::string>{"desk", "lab", "late"}));
  EXPECT_TRUE(authority_.find("desk")->is_revoked);
  EXPECT_FALSE(authority_.find("lab")->is_revoked);
}

TEST_F(KeysTest, AReplacementRevokesTheEarlierKeys) {
  const fs::path desk = authority_.add(hrtc("desk")), copy = folder_.path() / "copy";
  fs::copy(desk, copy);
  EXPECT_THAT(error_of([&] { (void)authority_.add(hrtc("desk")); }), HasSubstr("--replace"));
  NewMember again = hrtc("desk");
  again.replaces = true;
  EXPECT_EQ(error_of_member(authority_.add(again)), "");
  fs::copy_file(desk / files::kRevoked, copy / files::kRevoked, fs::copy_options::overwrite_existing);
  EXPECT_THAT(error_of_member(copy), HasSubstr("is revoked"));
}

TEST_F(KeysTest, NamesTheFileThatIsMissingOrOfAnotherMember) {
  const Authority other = Authority::create(folder_.path() / "other-keys");
  const fs::path desk = authority_.add(hrtc("desk")), lab = authority_.add(hrtc("lab")),
                 foreign = other.add(hrtc("desk"));
  const auto replace = [&](const char* file, const fs::path& from) {
    fs::copy_file(from / file, desk / file, fs::copy_options::overwrite_existing);
  };
  EXPECT_THAT(error_of_member(folder_.path() / "misspelt"), HasSubstr("misspelt: found no folder"));
  EXPECT_THAT(error_of_member(folder_.path()),
              HasSubstr("identity-ca.pem: not found, or not readable; expected the folder of a member"));
  replace(files::kPrivateKey, lab);
  EXPECT_THAT(error_of_member(desk), HasSubstr("private-key.pem: found the key of another certificate"));
  replace(files::kCertificate, foreign);
  EXPECT_THAT(error_of_member(desk), HasSubstr("found a certificate of another authority"));
  test_support::write_bytes(desk / files::kCertificate, "nothing");
  EXPECT_THAT(error_of_member(desk), HasSubstr("certificate.pem: found no certificate (PEM)"));
  fs::permissions(lab / files::kPrivateKey, fs::perms::group_read, fs::perm_options::add);
  const fs::path spaces = folder_.path() / "ann's keys";
  fs::copy(lab, spaces);
  EXPECT_THAT(error_of_member(spaces), HasSubstr("/ann'\\''s keys/private-key.pem'")) << "one word for a shell";
}

TEST_F(KeysTest, DocumentsOfAnotherMemberOrAuthorityAreRefused) {
  const Authority other = Authority::create(folder_.path() / "other-keys");
  const fs::path desk = authority_.add(hrtc("desk")), lab = authority_.add(hrtc("lab")),
                 foreign = other.add(hrtc("desk"));
  for (const char* file : {files::kPermissions, files::kGovernance}) {
    const std::string own = test_support::read_bytes(desk / file);
    std::string changed = own;
    changed.at(changed.find("<domains>") + 1) = 'D';
    for (const std::string& text : {test_support::read_bytes(foreign / file), changed, own.substr(0, own.size() / 2),
                                    std::string{}, std::string{"no document"}}) {
      test_support::write_bytes(desk / file, text);
      EXPECT_THAT(error_of_member(desk), HasSubstr(std::string{file} + ": found no document that the authority has"));
    }
    test_support::write_bytes(desk / file, own);
  }
  test_support::write_bytes(desk / files::kPermissions, test_support::read_bytes(lab / files::kPermissions));
  EXPECT_THAT(error_of_member(desk), HasSubstr("permissions.p7s: found the permissions of another certificate"));
}

TEST_F(KeysTest, AListOfAnotherAuthorityIsRefused) {
  const Authority other = Authority::create(folder_.path() / "other-keys");
  const fs::path desk = authority_.add(hrtc("desk")), foreign = other.add(hrtc("desk"));
  fs::copy_file(foreign / files::kRevoked, desk / files::kRevoked, fs::copy_options::overwrite_existing);
  EXPECT_THAT(error_of_member(desk), HasSubstr("revoked.pem: found the list of another authority"));
  test_support::write_bytes(desk / files::kRevoked, "");
  EXPECT_THAT(error_of_member(desk), AllOf(HasSubstr("copy that of the authority"), Not(HasSubstr("error:"))))
      << "no text of OpenSSL";
}

TEST_F(KeysTest, AMachineWhoseClockIsLateAcceptsTheList) {
  const fs::path desk = authority_.add(hrtc("desk")), lab = authority_.add(hrtc("lab"));
  authority_.revoke("lab");
  EXPECT_EQ(error_of_member(desk, std::time(nullptr) - 1800), "");
}

TEST_F(KeysTest, AMemberWithoutACertificateIsNotFoundAndCanBeReplaced) {
  const fs::path desk = authority_.add(hrtc("desk"));
  fs::remove(desk / files::kCertificate);
  EXPECT_FALSE(authority_.find("desk"));
  NewMember again = hrtc("desk");
  again.replaces = true;
  EXPECT_EQ(error_of_member(authority_.add(again)), "");
  EXPECT_EQ(std::distance(fs::directory_iterator{desk.parent_path()}, fs::directory_iterator{}), 1)
      << "the earlier folder is removed";
}

TEST_F(KeysTest, KeysWhoseCertificateCannotBeReadAreNotReplacedWithoutRevocation) {
  const fs::path desk = authority_.add(hrtc("desk"));
  test_support::write_bytes(desk / files::kCertificate, "damaged");
  NewMember again = hrtc("desk");
  again.replaces = true;
  EXPECT_THAT(error_of([&] { (void)authority_.add(again); }),
              AllOf(HasSubstr((desk / files::kCertificate).string()), HasSubstr("remove the file")));
}

TEST_F(KeysTest, KeysAreReplacedOnAFileSystemThatCannotExchangeFolders) {
  const fs::path desk = authority_.add(hrtc("desk"));
  const std::string serial = authority_.find("desk")->serial;
  std::string error;
  std::thread{[&] {  // the filter stays for the rest of the thread
    refuse_exchanges();
    NewMember again = hrtc("desk");
    again.replaces = true;
    error = error_of([&] { (void)authority_.add(again); });
  }}
      .join();
  EXPECT_EQ(error, "");
  EXPECT_EQ(error_of_member(desk), "");
  EXPECT_NE(authority_.find("desk")->serial, serial);
  EXPECT_EQ(std::distance(fs::directory_iterator{desk.parent_path()}, fs::directory_iterator{}), 1)
      << "the earlier folder is removed";
}

TEST_F(KeysTest, AnExportRemovesTheTemporaryFolderOfOneThatWasKilled) {
  (void)authority_.add(hrtc("desk"));
  const fs::path copy = folder_.path() / "desk-keys";
  const fs::path remain = folder_.path() / ".new-desk-keys.aB3xYz",
                 other = folder_.path() / ".new-desk-keys.old.aB3xYz";
  for (const fs::path& path : {remain, other}) fs::create_directory(path);
  authority_.export_member("desk", copy);
  EXPECT_EQ(error_of_member(copy), "");
  EXPECT_FALSE(fs::exists(remain));
  EXPECT_TRUE(fs::exists(other)) << "it would have got another name";
}

TEST_F(KeysTest, TemporaryFilesOfAKilledRunAreRemoved) {
  const fs::path desk = authority_.add(hrtc("desk")), members = desk.parent_path();
  const std::vector<fs::path> remains{members / ".new-late.aB3xYz", desk / ".new-revoked.pem.aB3xYz",
                                      members.parent_path() / "authority/.new-revoked.pem.aB3xYz"};
  const std::vector<fs::path> of_user{members / ".git", members / ".desk.backup"};
  for (const fs::path& path : {remains[0], of_user[0], of_user[1]}) fs::create_directory(path);
  test_support::write_bytes(remains[0] / files::kPrivateKey, "secret");
  for (const fs::path& path : {remains[1], remains[2]}) test_support::write_bytes(path, "part");
  authority_.revoke("desk");
  for (const fs::path& path : remains) EXPECT_FALSE(fs::exists(path)) << path;
  for (const fs::path& path : of_user) EXPECT_TRUE(fs::exists(path)) << path;
}

TEST_F(KeysTest, EachListIsNewerThanTheOneBeforeEvenIfTheClockIsNot) {
  (void)authority_.add(hrtc("desk"));
  std::time_t before = authority_.revoked().made;
  for (int i = 0; i < 3; ++i) {  // within a second
    authority_.revoke("desk");
    EXPECT_GT(authority_.revoked().made, before);
    before = authority_.revoked().made;
  }
}

TEST_F(KeysTest, WrongNamesAndFoldersAreRefused) {
  for (const char* name : {"", "../desk", "a/b", ".hidden", "O=lab", "two words"})
    EXPECT_THAT(error_of([&] { (void)authority_.add(hrtc(name)); }), HasSubstr("expected 1 to 63 letters")) << name;
  NewMember member = hrtc("desk");
  member.permitted = {"ann*"};
  EXPECT_THAT(error_of([&] { (void)authority_.add(member); }), HasSubstr("user: found 'ann*'"));
  member.permitted.assign(9, std::string(63, 'a'));
  EXPECT_THAT(error_of([&] { (void)authority_.add(member); }),
              HasSubstr("found 575 characters with the spaces between the names, expected at most 511"));
  member.permitted = {"ann"};
  member.role = Role::kObserver;
  EXPECT_THAT(error_of([&] { (void)authority_.add(member); }), HasSubstr("expected no users or objects"));
  member = hrtc("desk");
  member.days = 0;
  EXPECT_THAT(error_of([&] { (void)authority_.add(member); }), HasSubstr("days: found 0, expected 1 to 3650"));
  EXPECT_THAT(error_of([&] { authority_.revoke("nobody"); }), HasSubstr("expected a member of this authority"));
  EXPECT_THAT(error_of([&] { (void)Authority::create(folder_.path() / "lab-keys"); }), HasSubstr("exists"));
  EXPECT_THAT(error_of([&] { (void)Authority::create(folder_.path() / "no" / "keys"); }), HasSubstr("found no folder"));
  EXPECT_THAT(error_of([&] { (void)Authority{folder_.path()}; }), HasSubstr("found no authority"));
}

TEST(Permissions, AUserMovesTheHandsOfItsUsersOnly) {
  const std::string text = permissions_document("CN=laptop", Role::kUser, {"ann", "bob"}, 0, kDay);
  EXPECT_THAT(text, HasSubstr("<publish><topics><topic>tactus_intent</topic><topic>tactus_device_pose</topic></topics>"
                              "<partitions><partition>*/u/ann</partition><partition>*/u/bob</partition></partitions>"));
  EXPECT_THAT(text, AllOf(Not(HasSubstr("tactus_reset")), Not(HasSubstr("tactus_end")), HasSubstr("tactus_stop")));
  EXPECT_THAT(text, HasSubstr("<default>DENY</default>"));
  EXPECT_THAT(permissions_document("CN=boss", Role::kOperator, {"ann"}, 0, kDay), HasSubstr("tactus_reset"));
  const std::string observer = permissions_document("CN=screen", Role::kObserver, {}, 0, kDay);
  EXPECT_THAT(observer, AllOf(Not(HasSubstr("tactus_intent")), HasSubstr("tactus_stop"), HasSubstr("tactus_roster")));
}

TEST(Permissions, HaveAMarginForTheTimeZoneOfAMachine) {  // Fast DDS reads them as local times
  const std::string text = permissions_document("CN=desk", Role::kHrtc, {}, 10 * kDay, 20 * kDay);
  EXPECT_THAT(text, HasSubstr("<not_before>1970-01-10T00:00:00</not_before>"));
  EXPECT_THAT(text, HasSubstr("<not_after>1970-01-22T00:00:00</not_after>"));
}

TEST(Permissions, AreThoseOfTheRole) {
  const auto topics_of = [](Role role) {
    std::set<std::string> topics;
    for (const WriteRight& right : rights_of(role)) topics.insert(right.topic);
    return topics;
  };
  EXPECT_EQ(topics_of(Role::kObserver),
            (std::set<std::string>{"tactus_roster", "tactus_clock", "tactus_stop", "tactus_demand"}));
  EXPECT_EQ(topics_of(Role::kHost),
            (std::set<std::string>{"tactus_roster", "tactus_clock", "tactus_stop", "tactus_catalogue", "tactus_base",
                                   "tactus_records", "tactus_object_grant", "tactus_metrics", "tactus_object_pose"}));
  for (const Role role : {Role::kHost, Role::kHrtc, Role::kUser, Role::kObserver}) {
    EXPECT_EQ(topics_of(role).count("tactus_reset") + topics_of(role).count("tactus_end"), 0u) << name_of(role);
  }
  for (const Role role : {Role::kHost, Role::kUser, Role::kOperator, Role::kObserver})
    EXPECT_EQ(topics_of(role).count("tactus_probe_state"), 0u) << name_of(role);
}

TEST(Permissions, NameTheRolesThatMayWriteATopic) {
  EXPECT_EQ(writers_of("tactus_reset"), std::vector<Role>{Role::kOperator});
  EXPECT_EQ(writers_of("tactus_metrics"), (std::vector<Role>{Role::kHost, Role::kHrtc}));
}

TEST(Permissions, EscapesWhatXmlReserves) {
  EXPECT_THAT(permissions_document("CN=a<b&c", Role::kHost, {}, 0, kDay), HasSubstr("CN=a&lt;b&amp;c"));
}

}  // namespace
}  // namespace tactus::keys
