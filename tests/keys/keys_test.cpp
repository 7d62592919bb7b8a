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
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "keys/authority.hpp"
#include "keys/certificates.hpp"
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

/// Returns for which reason the library refuses the certificate of a member, by the list in its folder; "ok": for none.
std::string verified(const fs::path& folder) {
  const Certificate authority = read_certificate(folder / files::kIdentityCa),
                    certificate = read_certificate(folder / files::kCertificate);
  const RevokedList list = read_revoked_list(folder / files::kRevoked);
  const std::unique_ptr<X509_STORE, decltype(&X509_STORE_free)> store{X509_STORE_new(), &X509_STORE_free};
  const std::unique_ptr<X509_STORE_CTX, decltype(&X509_STORE_CTX_free)> context{X509_STORE_CTX_new(),
                                                                                &X509_STORE_CTX_free};
  EXPECT_EQ(X509_STORE_add_cert(store.get(), authority.get()), 1);
  EXPECT_EQ(X509_STORE_add_crl(store.get(), list.get()), 1);
  EXPECT_EQ(X509_STORE_CTX_init(context.get(), store.get(), certificate.get(), nullptr), 1);
  X509_STORE_CTX_set_flags(context.get(), X509_V_FLAG_CRL_CHECK);  // as Fast DDS does
  (void)X509_verify_cert(context.get());
  return X509_verify_cert_error_string(X509_STORE_CTX_get_error(context.get()));
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

  [[nodiscard]] Issuer issuer() const {
    const fs::path authority = folder_.path() / "lab-keys/authority";
    return {read_certificate(authority / files::kIdentityCa), read_key(authority / "identity-ca.key")};
  }
  /// Gives a list to the authority and to all members.
  void write_list(X509_CRL& list) const {
    test_support::write_bytes(folder_.path() / "lab-keys/authority" / files::kRevoked, pem_of(list));
    for (const std::string& name : authority_.names())
      test_support::write_bytes(authority_.folder_of(name) / files::kRevoked, pem_of(list));
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

TEST_F(KeysTest, AListThatWasMadeWithAWrongClockIsUsedAndLaterOnesReplaceIt) {
  const fs::path desk = authority_.add(hrtc("desk")), lab = authority_.add(hrtc("lab"));
  const std::time_t now = std::time(nullptr), wrong = now + 3650 * kDay;
  EXPECT_EQ(clock_warning(authority_.revoked(), now), "");
  write_list(*make_revoked_list(issuer(), {}, wrong));
  EXPECT_EQ(authority_.revoked().made, wrong);
  EXPECT_EQ(error_of_member(desk, now), "");
  EXPECT_EQ(verified(desk), "ok");
  EXPECT_THAT(clock_warning(authority_.revoked(), now),
              AllOf(HasSubstr("found " + utc_text(wrong)), HasSubstr("set it"), HasSubstr("--replace")));
  std::time_t before = wrong;
  for (const char* name : {"lab", "lab", "desk"}) {
    EXPECT_EQ(error_of_member(desk, now), "");
    EXPECT_EQ(verified(desk), "ok");
    authority_.revoke(name);
    EXPECT_GT(read_revoked(desk).made, before);
    before = read_revoked(desk).made;
  }
  for (const fs::path& revoked : {desk, lab}) {
    EXPECT_THAT(error_of_member(revoked, now), HasSubstr("is revoked"));
    EXPECT_EQ(verified(revoked), "certificate revoked");
  }
}

TEST_F(KeysTest, ARevocationReplacesAListOfAnEarlierVersionThatIsNotValidYet) {
  const fs::path desk = authority_.add(hrtc("desk"));
  (void)authority_.add(hrtc("lab"));
  const std::time_t now = std::time(nullptr), wrong = now + 3650 * kDay;
  const Issuer authority = issuer();
  const RevokedList list = make_revoked_list(authority, {}, wrong);
  X509_EXTENSION_free(X509_CRL_delete_ext(list.get(), X509_CRL_get_ext_by_NID(list.get(), NID_crl_number, -1)));
  const std::unique_ptr<ASN1_TIME, decltype(&ASN1_TIME_free)> from{ASN1_TIME_set(nullptr, wrong), &ASN1_TIME_free};
  ASSERT_EQ(X509_CRL_set1_lastUpdate(list.get(), from.get()), 1);
  ASSERT_GT(X509_CRL_sign(list.get(), authority.key.get(), EVP_sha256()), 0);
  write_list(*list);
  EXPECT_EQ(verified(desk), "CRL is not yet valid");
  EXPECT_THAT(error_of_member(desk, now),
              AllOf(HasSubstr("revoked.pem: found a list that is valid from " + utc_text(wrong)),
                    HasSubstr("is the clock of this machine right?"), HasSubstr("tactus keys revoke")));
  const std::time_t before = authority_.revoked().made;
  authority_.revoke("lab");
  EXPECT_EQ(error_of_member(desk, now), "");
  EXPECT_EQ(verified(desk), "ok");
  EXPECT_GT(authority_.revoked().made, before);
}

TEST_F(KeysTest, AnExportHasTheListOfTheAuthorityAndNoRevokedKeys) {
  const fs::path desk = authority_.add(hrtc("desk")), lab = authority_.add(hrtc("lab"));
  const std::string before = test_support::read_bytes(lab / files::kRevoked);
  authority_.revoke("desk");
  for (const fs::path& member : {desk, lab}) test_support::write_bytes(member / files::kRevoked, before);
  const fs::path desk_keys = folder_.path() / "desk-keys", lab_keys = folder_.path() / "lab-copy";
  EXPECT_THAT(error_of([&] { authority_.export_member("desk", desk_keys); }),
              AllOf(HasSubstr("the certificate of hrtc 'desk' is revoked"), HasSubstr("--replace")));
  EXPECT_FALSE(fs::exists(desk_keys));
  authority_.export_member("lab", lab_keys);
  EXPECT_EQ(error_of_member(lab_keys), "");
  EXPECT_EQ(read_revoked(lab_keys).serials, authority_.revoked().serials);
}

TEST_F(KeysTest, ARevocationReachesAllMembersThatCanHaveTheList) {
  const fs::path desk = authority_.add(hrtc("desk")), lab = authority_.add(hrtc("lab")),
                 damaged = authority_.add(hrtc("k"));  // between the two
  test_support::write_bytes(desk.parent_path() / "e-notes.txt", "");
  EXPECT_EQ(authority_.names(), (std::vector<std::string>{"desk", "k", "lab"}));
  authority_.revoke("desk");
  const std::vector<std::string> first = authority_.revoked().serials;
  for (const fs::path& member : {desk, damaged, lab}) EXPECT_EQ(read_revoked(member).serials, first) << member;
  fs::remove(damaged / files::kRevoked);
  fs::create_directory(damaged / files::kRevoked);
  EXPECT_THAT(error_of([&] { authority_.revoke("k"); }),
              AllOf(HasSubstr((damaged / files::kRevoked).string()), HasSubstr("repeat the command")));
  for (const fs::path& member : {desk, lab}) EXPECT_EQ(read_revoked(member).serials.size(), 2u) << member;
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
