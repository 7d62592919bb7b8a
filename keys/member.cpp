#include "keys/member.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <array>

#include "keys/certificates.hpp"
#include "keys/documents.hpp"

namespace tactus::keys {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, std::size(kRoles)> kNames{"host",     "hrtc",     "user",
                                                                 "operator", "observer", "tester"};

constexpr char kBetweenNames = ' ';

Role role_of(const std::string& name, const fs::path& file) {
  const auto found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end())
    throw KeyError(file.string() + ": found the role '" + name + "', expected a certificate of tactus keys");
  return static_cast<Role>(found - kNames.begin());
}

/// One word of a command line.
std::string quoted(const std::string& text) {
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? std::string{"'\\''"} : std::string{c};
  return word + "'";
}

/// Other users of the machine could act as this member.
void check_owner(const fs::path& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) == 0 && (status.st_mode & (S_IRWXG | S_IRWXO)) != 0)
    throw KeyError(file.string() + ": other users can read it, expected only its owner; run: chmod 600 " +
                   quoted(file.string()));
}

/// Reads the list of revoked certificates of this authority.
RevokedList read_list(const fs::path& folder, X509& authority) {
  RevokedList list = read_revoked_list(folder / files::kRevoked);
  if (!is_issued_by(*list, authority))
    throw KeyError((folder / files::kRevoked).string() + ": found the list of another authority than " +
                   (folder / files::kIdentityCa).string());
  return list;
}

/// Fast DDS states no reason for documents that it refuses.
void check_documents(const fs::path& folder, X509& certificate) {
  const Certificate authority = read_certificate(folder / files::kPermissionsCa);
  (void)read_signed(folder / files::kGovernance, *authority);
  const fs::path permissions = folder / files::kPermissions;
  if (!is_for(read_signed(permissions, *authority), subject_text(certificate)))
    throw KeyError(permissions.string() + ": found the permissions of another certificate than " +
                   (folder / files::kCertificate).string() + "; copy the whole folder of the member again");
}

}  // namespace

std::string utc_text(std::time_t time, const char* format) {
  std::array<char, 32> text{};
  std::tm utc{};
  gmtime_r(&time, &utc);
  std::strftime(text.data(), text.size(), format, &utc);
  return text.data();
}

std::string_view name_of(Role role) noexcept { return kNames[static_cast<std::size_t>(role)]; }

std::string replace_command(const Member& member) {
  return "tactus keys add-" + std::string{name_of(member.role)} + " " + member.group + " " + member.name + " --replace";
}

std::string text_of(const Permitted& permitted) {
  std::string text;
  for (const std::string& name : permitted) {
    if (!text.empty()) text += kBetweenNames;
    text += name;
  }
  return text;
}

Permitted permitted_in(std::string_view text) {
  Permitted permitted;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find(kBetweenNames), text.size());
    permitted.emplace_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return permitted;
}

Member member_of(X509& certificate, X509_CRL& revoked, const fs::path& file) {
  const Subject subject = subject_of(certificate);
  const std::vector<std::string> serials = serials_of(revoked);
  Member member;
  member.name = subject.name;
  member.role = role_of(subject.unit, file);
  member.group = subject.group;
  member.permitted = subject.permitted;
  member.valid_from = valid_from(certificate);
  member.valid_until = valid_until(certificate);
  member.serial = serial_of(certificate);
  const bool has_users = member.role == Role::kUser || member.role == Role::kOperator;
  if (subject.serial != member.serial || subject.until != std::to_string(member.valid_until) ||
      (has_users && member.permitted.empty()))
    throw KeyError(file.string() +
                   ": found a certificate of an earlier version of tactus keys; make a new one with: tactus keys add-" +
                   std::string{name_of(member.role)} + " AUTHORITY " + subject.name + (has_users ? " USER..." : "") +
                   " --replace");
  member.is_revoked = std::find(serials.begin(), serials.end(), member.serial) != serials.end();
  return member;
}

Member read_member(const fs::path& folder, std::time_t now) {
  using namespace files;
  std::error_code ignored;
  if (!fs::is_directory(folder, ignored))
    throw KeyError(folder.string() +
                   ": found no folder that can be read, expected that of a member, made by tactus keys");
  for (const char* name :
       {kIdentityCa, kPermissionsCa, kCertificate, kPrivateKey, kGovernance, kPermissions, kRevoked}) {
    std::error_code error;
    if (!fs::exists(folder / name, error))
      throw KeyError((folder / name).string() +
                     ": not found, or not readable; expected the folder of a member that tactus keys has made");
  }
  const Certificate certificate = read_certificate(folder / kCertificate);
  const Certificate authority = read_certificate(folder / kIdentityCa);
  const std::string file = (folder / kCertificate).string();
  if (!is_issued_by(*certificate, *authority))
    throw KeyError(file + ": found a certificate of another authority than " + (folder / kIdentityCa).string());
  check_owner(folder / kPrivateKey);
  if (!belongs_to(*read_key(folder / kPrivateKey), *certificate))
    throw KeyError((folder / kPrivateKey).string() + ": found the key of another certificate than " + file);
  check_documents(folder, *certificate);
  const RevokedList list = read_list(folder, *authority);
  if (now < valid_from(*list))
    throw KeyError((folder / kRevoked).string() + ": found a list that is valid from " + utc_text(valid_from(*list)) +
                   " on; is the clock of this machine right? If it is, make a new list on the machine of the "
                   "authority (tactus keys revoke, or add-... --replace), and copy it");
  const Member member = member_of(*certificate, *list, folder / kCertificate);
  const std::string who = std::string{name_of(member.role)} + " '" + member.name + "'";
  if (member.is_revoked)
    throw KeyError(file + ": the certificate of " + who + " is revoked; the owner of the authority can make a new one");
  if (now < member.valid_from)
    throw KeyError(file + ": the certificate of " + who + " is valid from " + utc_text(member.valid_from) +
                   " on; is the clock of this machine right? If it is, make a new one on the machine of the "
                   "authority with: " +
                   replace_command(member));
  if (now > member.valid_until)
    throw KeyError(file + ": the certificate of " + who + " has expired on " + utc_text(member.valid_until) +
                   "; make a new one on the machine of the authority with: " + replace_command(member));
  return member;
}

RevokedKeys read_revoked(const fs::path& folder) {
  const RevokedList list = read_list(folder, *read_certificate(folder / files::kIdentityCa));
  return {serials_of(*list), made_at(*list)};
}

std::string text_of(const RevokedKeys& revoked) {
  const std::size_t count = revoked.serials.size();
  return std::to_string(count) + (count == 1 ? " revoked key, list of " : " revoked keys, list of ") +
         utc_text(revoked.made);
}

std::string clock_warning(const RevokedKeys& revoked, std::time_t now) {
  if (revoked.made <= now + kClockTolerance) return "";
  return "The list of revoked keys has a wrong time: found " + utc_text(revoked.made) + ", expected one before " +
         utc_text(now) +
         ". The clock of this machine is wrong, or was wrong when the list was made: set it. All programs accept the "
         "list, and later lists replace it. Replace the keys that were made with the wrong clock "
         "(tactus keys add-... --replace).";
}

}  // namespace tactus::keys
