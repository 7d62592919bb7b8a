#include "keys/authority.hpp"

#include <fcntl.h>
#include <stdio.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>
#include <utility>

#include "keys/certificates.hpp"
#include "keys/documents.hpp"

namespace tactus::keys {
namespace {

namespace fs = std::filesystem;

constexpr std::time_t kDay = 24 * 3600;

constexpr char kAuthorityFolder[] = "authority", kMembersFolder[] = "members";
constexpr char kIdentityKey[] = "identity-ca.key", kPermissionsKey[] = "permissions-ca.key";

[[noreturn]] void fail(const fs::path& path, const char* what) {
  throw KeyError(path.string() + ": " + what + ": " + std::strerror(errno));
}

/// Writes a new file that only its owner can read, and waits until the disk has it.
void write_file(const fs::path& path, const std::string& text) {
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, S_IRUSR | S_IWUSR);
  if (file < 0) fail(path, "cannot be made");
  errno = ENOSPC;  // for a write that is too short
  const bool is_written =
      ::write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size()) && ::fsync(file) == 0;
  const int error = errno;
  ::close(file);
  errno = error;
  if (!is_written) fail(path, "cannot be written");
}

void sync_folder(const fs::path& folder) {
  const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return;
  (void)::fsync(descriptor);
  ::close(descriptor);
}

constexpr std::string_view kNew = ".new-", kUnique = ".XXXXXX";  // mkdtemp() and mkstemp() replace the X

/// Names of members and of their files begin with no point; those of Pending do.
bool is_hidden(const fs::path& path) { return path.filename().string().front() == '.'; }
bool is_temporary(const fs::path& path) {
  const std::string name = path.filename();
  return name.size() > kNew.size() + kUnique.size() && name.compare(0, kNew.size(), kNew) == 0 &&
         name[name.size() - kUnique.size()] == '.';
}

/// Removes the temporary files and folders that would have got this name.
void remove_temporary(const fs::path& folder, const std::string& name) {
  std::error_code ignored;
  std::vector<fs::path> remains;
  const std::string begin = std::string{kNew} + name + ".";
  for (fs::directory_iterator at{folder, ignored}, end; at != end; at.increment(ignored))
    if (is_temporary(at->path()) && at->path().filename().string().size() == begin.size() + kUnique.size() - 1 &&
        at->path().filename().string().compare(0, begin.size(), begin) == 0)
      remains.push_back(at->path());
  for (const fs::path& path : remains) fs::remove_all(path, ignored);
}

/// A new folder, or a new file, that gets its name only when it is complete. Without `commit` nothing remains.
class Pending {
 public:
  /// `path` is in an existing folder.
  static Pending folder(const fs::path& path) {
    Pending pending{path};
    std::string name = pending.pattern();
    if (::mkdtemp(name.data()) == nullptr) fail(path, "cannot be made");
    pending.temporary_ = name;
    return pending;
  }
  static Pending file(const fs::path& path, const std::string& text) {
    Pending pending{path};
    std::string name = pending.pattern();
    const int file = ::mkstemp(name.data());
    if (file < 0) fail(path, "cannot be made");
    ::close(file);
    fs::remove(name);
    pending.temporary_ = name;
    write_file(name, text);
    return pending;
  }
  Pending(Pending&& other) noexcept : path_{std::move(other.path_)}, temporary_{std::exchange(other.temporary_, {})} {}
  Pending(const Pending&) = delete;
  Pending& operator=(const Pending&) = delete;
  ~Pending() {
    std::error_code ignored;
    if (!temporary_.empty()) fs::remove_all(temporary_, ignored);
  }
  [[nodiscard]] const fs::path& temporary() const noexcept { return temporary_; }
  void commit() {
    if (fs::is_directory(temporary_)) sync_folder(temporary_);
    if (::rename(temporary_.c_str(), path_.c_str()) != 0) fail(path_, "cannot be made");
    temporary_.clear();
    sync_folder(path_.parent_path());
  }
  /// Takes the place of a folder, in one step. The destructor removes the earlier one.
  void exchange() {
    sync_folder(temporary_);
    if (::renameat2(AT_FDCWD, temporary_.c_str(), AT_FDCWD, path_.c_str(), RENAME_EXCHANGE) != 0) {
      if (errno != EINVAL) fail(path_, "cannot be replaced");
      replace();
    }
    sync_folder(path_.parent_path());
  }

 private:
  explicit Pending(fs::path path) : path_{std::move(path)} {}
  /// For file systems without an exchange, such as NFS: between its two steps there is no folder of this name.
  void replace() {
    Pending earlier = folder(path_);
    if (::rename(path_.c_str(), earlier.temporary_.c_str()) != 0) fail(path_, "cannot be replaced");
    commit();
  }
  [[nodiscard]] std::string pattern() const {
    return path_.parent_path() / std::string{kNew}.append(path_.filename().string()).append(kUnique);
  }
  fs::path path_, temporary_;
};

/// Lets other programs that change the authority wait.
class Lock {
 public:
  explicit Lock(const fs::path& folder)
      : descriptor_{::open((folder / kAuthorityFolder).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)} {
    if (descriptor_ < 0 || ::flock(descriptor_, LOCK_EX) != 0) fail(folder, "cannot be locked");
  }
  ~Lock() { ::close(descriptor_); }
  Lock(const Lock&) = delete;
  Lock& operator=(const Lock&) = delete;

 private:
  int descriptor_;
};

/// Names become file names, and parts of certificates and of permissions. `more`: further characters that may occur.
void check_name(const char* what, const std::string& name, std::string_view more = ".") {
  constexpr std::size_t kMaxName = 63;
  const bool has_only_valid = std::all_of(name.begin(), name.end(), [&](char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '-' || c == '_' ||
           more.find(c) != std::string_view::npos;
  });
  if (name.empty() || name.size() > kMaxName || !has_only_valid || name.front() == '.')
    throw KeyError(std::string{what} + ": found '" + name + "', expected 1 to 63 letters, digits, hyphens" +
                   (more.empty() ? " and underscores" : ", underscores and points, no point at the begin"));
}

/// A point separates the name of a member from that of one of its programs (keys/identity.hpp).
void check_member_name(const std::string& name) { check_name("name", name, ""); }

/// Returns the names that restrict a new member.
Permitted permitted_of(const NewMember& added) {
  const bool brings_users = added.role == Role::kUser || added.role == Role::kOperator;
  if (added.permitted.empty()) return brings_users ? Permitted{added.name} : Permitted{};
  if (!brings_users && added.role != Role::kHrtc && added.role != Role::kHost)
    throw KeyError("names: found '" + text_of(added.permitted) + "', expected no users or objects for the role " +
                   std::string{name_of(added.role)});
  const std::string kind = added.role == Role::kHost ? "object" : "user";
  for (const std::string& name : added.permitted) check_name(kind.c_str(), name);
  if (const std::size_t size = text_of(added.permitted).size(); size > kMaxPermitted)
    throw KeyError("names of " + kind + "s: found " + std::to_string(size) +
                   " characters with the spaces between the names, expected at most " + std::to_string(kMaxPermitted));
  return added.permitted;
}

Issuer read_issuer(const fs::path& folder, const char* certificate, const char* key) {
  return {read_certificate(folder / certificate), read_key(folder / key)};
}
Issuer identities_of(const fs::path& folder) {
  return read_issuer(folder / kAuthorityFolder, files::kIdentityCa, kIdentityKey);
}

std::time_t now() { return std::time(nullptr); }

/// Copies a file such that only its owner can read it, and waits until the disk has it.
void copy(const fs::path& from, const fs::path& to, const char* name) {
  std::ifstream in{from / name, std::ios::binary};
  const std::string text{std::istreambuf_iterator<char>{in}, {}};
  if (!in) fail(from / name, "cannot be read");
  write_file(to / name, text);
  fs::permissions(to / name, fs::perms::owner_read | fs::perms::owner_write);
}

/// Returns the absolute path of a folder, whose name may have a separator at its end.
fs::path without_separator(const fs::path& folder) {
  return folder.has_filename() ? fs::absolute(folder) : fs::absolute(folder).parent_path();
}

}  // namespace

Authority Authority::create(const fs::path& folder) {
  if (fs::exists(folder)) throw KeyError(folder.string() + ": exists, expected a new folder");
  const fs::path path = without_separator(folder);
  const std::string group = path.filename();
  check_name("name of the authority", group);
  if (!fs::is_directory(path.parent_path())) throw KeyError(path.parent_path().string() + ": found no folder");
  Pending pending = Pending::folder(path);
  const fs::path authority = pending.temporary() / kAuthorityFolder;
  fs::create_directory(authority);
  fs::permissions(authority, fs::perms::owner_all);
  fs::create_directory(pending.temporary() / kMembersFolder);
  const std::time_t from = now() - kClockTolerance, until = now() + kMaxDays * kDay;
  const Issuer identities = make_issuer({group, "authority", "identities"}, from, until);
  const Issuer permissions = make_issuer({group, "authority", "permissions"}, from, until);
  write_file(authority / files::kIdentityCa, pem_of(*identities.certificate));
  write_file(authority / kIdentityKey, pem_of(*identities.key));
  write_file(authority / files::kPermissionsCa, pem_of(*permissions.certificate));
  write_file(authority / kPermissionsKey, pem_of(*permissions.key));
  write_file(authority / files::kGovernance, sign(permissions, governance_document()));
  write_file(authority / files::kRevoked, pem_of(*make_revoked_list(identities, {}, now())));
  sync_folder(authority);
  pending.commit();
  return Authority{path};
}

Authority::Authority(fs::path folder) : folder_{std::move(folder)} {
  std::error_code error;
  if (fs::exists(folder_ / kAuthorityFolder / kIdentityKey, error)) return;
  throw KeyError(folder_.string() + ": found no authority" + (error ? ": " + error.message() : "") +
                 ", expected a folder of tactus keys init");
}

fs::path Authority::folder_of(const std::string& name) const { return folder_ / kMembersFolder / name; }

fs::path Authority::add(const NewMember& added) const {
  const Lock lock{folder_};
  check_member_name(added.name);
  const Permitted permitted = permitted_of(added);
  if (added.days < 1 || added.days > kMaxDays)
    throw KeyError("days: found " + std::to_string(added.days) + ", expected 1 to " + std::to_string(kMaxDays));
  const fs::path folder = folder_of(added.name);
  if (fs::exists(folder) && !added.replaces)
    throw KeyError(folder.string() + ": exists; --replace makes new keys and revokes the old ones");
  const fs::path authority = folder_ / kAuthorityFolder;
  const Issuer identities = identities_of(folder_);
  const Issuer permissions = read_issuer(authority, files::kPermissionsCa, kPermissionsKey);
  const std::time_t from = now() - kClockTolerance;
  const std::time_t until = std::min(now() + added.days * kDay, valid_until());
  if (until <= now()) throw KeyError(folder_.string() + ": the authority has expired; make a new one, with new keys");
  const Subject subject{subject_of(*identities.certificate).group, std::string{name_of(added.role)}, added.name,
                        permitted};
  const Key key = make_key();
  const Certificate certificate = issue(identities, subject, *key, from, until);
  Pending pending = Pending::folder(folder);
  const fs::path& made = pending.temporary();
  for (const char* name : {files::kIdentityCa, files::kPermissionsCa, files::kGovernance}) copy(authority, made, name);
  write_file(made / files::kCertificate, pem_of(*certificate));
  write_file(made / files::kPrivateKey, pem_of(*key));
  write_file(made / files::kPermissions,
             sign(permissions, permissions_document(subject_text(*certificate), added.role, permitted, from, until)));
  const bool exists = fs::exists(folder);
  // Without a certificate, of an earlier run that was killed, there is nothing to revoke.
  if (exists && fs::exists(folder / files::kCertificate)) revoke_certificate(added.name);
  copy(authority, made, files::kRevoked);
  if (exists)
    pending.exchange();
  else
    pending.commit();
  remove_remains();
  return folder;
}

void Authority::revoke(const std::string& name) const {
  check_member_name(name);
  const Lock lock{folder_};
  revoke_certificate(name);
  remove_remains();
}

/// Removes temporary files and folders. The caller has the lock, so no other process uses them.
void Authority::remove_remains() const {
  std::vector<fs::path> folders{folder_ / kAuthorityFolder, folder_ / kMembersFolder}, remains;
  std::error_code ignored;  // files that cannot be read or removed stay
  const fs::directory_iterator end;
  for (fs::directory_iterator at{folder_ / kMembersFolder, ignored}; at != end; at.increment(ignored))
    folders.push_back(at->path());
  for (const fs::path& folder : folders)
    for (fs::directory_iterator at{folder, ignored}; at != end; at.increment(ignored))
      if (is_temporary(at->path())) remains.push_back(at->path());
  for (const fs::path& path : remains) fs::remove_all(path, ignored);
}

void Authority::export_member(const std::string& name, const fs::path& to) const {
  const fs::path from = folder_of(name), target = without_separator(to);
  if (!fs::is_directory(from)) throw KeyError(from.string() + ": not found, expected a member of this authority");
  if (fs::exists(target)) throw KeyError(to.string() + ": exists, expected a new folder");
  const Lock lock{folder_};  // so that no process replaces the keys during the copy
  remove_temporary(target.parent_path(), target.filename());
  if (const std::optional<Member> member = find(name); member && member->is_revoked)
    throw KeyError((from / files::kCertificate).string() + ": the certificate of " +
                   std::string{name_of(member->role)} + " '" + name +
                   "' is revoked; make new keys with: " + replace_command(*member));
  (void)read_member(from, now());
  Pending pending = Pending::folder(target);
  try {
    for (const auto& entry : fs::directory_iterator{from}) {
      const fs::path file = entry.path().filename();
      // A revocation that was killed, or has failed, leaves the earlier list in the folders of members.
      if (!is_hidden(file))
        copy(file == files::kRevoked ? folder_ / kAuthorityFolder : from, pending.temporary(), file.c_str());
    }
  } catch (const fs::filesystem_error& error) {
    throw KeyError(to.string() + ": " + error.code().message() +
                   "; the file system may have no owners of files: use scp, or tar");
  }
  pending.commit();
}

RevokedKeys Authority::revoked() const { return read_revoked(folder_ / kAuthorityFolder); }

std::time_t Authority::valid_until() const {
  return keys::valid_until(*read_certificate(folder_ / kAuthorityFolder / files::kIdentityCa));
}

void Authority::revoke_certificate(const std::string& name) const {
  const fs::path file = folder_of(name) / files::kCertificate;
  if (!fs::exists(file)) throw KeyError(file.string() + ": not found, expected a member of this authority");
  std::vector<std::string> serials = serials_of(*read_revoked_list(folder_ / kAuthorityFolder / files::kRevoked));
  std::string serial;
  try {
    serial = serial_of(*read_certificate(file));
  } catch (const KeyError& error) {
    throw KeyError(std::string{error.what()} + "; without it, these keys cannot be revoked. If nobody has a copy of " +
                   "them, remove the file, and add the member again with --replace");
  }
  if (std::find(serials.begin(), serials.end(), serial) == serials.end()) serials.push_back(serial);
  write_revoked(serials);
}

/// The authority has the list first, so a repetition of an interrupted revocation completes it.
void Authority::write_revoked(const std::vector<std::string>& serials) const {
  const std::time_t made = std::max(now(), revoked().made + 1);  // programs refuse a list that is older than theirs
  const std::string text = pem_of(*make_revoked_list(identities_of(folder_), serials, made));
  Pending::file(folder_ / kAuthorityFolder / files::kRevoked, text).commit();
  std::string error;  // of the first member that does not get the list
  for (const std::string& name : names()) {
    try {
      Pending::file(folder_of(name) / files::kRevoked, text).commit();
    } catch (const KeyError& found) {
      if (error.empty()) error = found.what();
    }
  }
  if (!error.empty())
    throw KeyError(error + "; the keys are revoked, but this member has the earlier list. Repair its folder, and " +
                   "repeat the command");
}

std::optional<Member> Authority::find(const std::string& name) const {
  const fs::path file = folder_of(name) / files::kCertificate;
  if (!fs::exists(file)) return std::nullopt;  // or the folder is of an interrupted run
  return member_of(*read_certificate(file), *read_revoked_list(folder_ / kAuthorityFolder / files::kRevoked), file);
}

std::vector<std::string> Authority::names() const {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator{folder_ / kMembersFolder})
    if (!is_hidden(entry.path()) && entry.is_directory()) names.push_back(entry.path().filename());
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace tactus::keys
