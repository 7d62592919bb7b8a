/// Makes the keys of a secured session.
///
/// An authority is a folder with two certificate authorities: one for identities, one for permissions. They differ,
/// because some versions of Fast DDS accept permissions that a member has signed if both are the same (CVE-2023-24010).
///
///     lab-keys/authority/   private keys of both authorities; stays where it was made
///     lab-keys/members/desk/   all that the program `desk` needs; copied to its machine
///
/// Every file and folder gets its name only when it is complete. A process that makes, revokes or exports keys waits
/// for other such processes, and then removes the temporary files of those that were killed. If `create` or
/// `export_member` is killed, its folder `.new-NAME.*` stays. The next export to the same name removes the folder that
/// a killed export has left. On a file system without an exchange of folders, such as NFS, a process that is killed
/// while it replaces keys can leave no folder of this name.
#pragma once

#include <ctime>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "keys/member.hpp"

namespace tactus::keys {

/// An authority is valid for this number of days.
inline constexpr int kMaxDays = 3650;

struct NewMember {
  std::string name;
  Role role = Role::kObserver;
  Permitted permitted;    ///< empty, for a user or an operator: one user with the name of the member
  int days = 365;         ///< for which the certificate is valid
  bool replaces = false;  ///< a member of this name may exist; its certificate is revoked
};

class Authority {
 public:
  /// Makes a new authority in a folder that does not exist yet. Throws KeyError.
  static Authority create(const std::filesystem::path& folder);
  /// Opens the authority of a folder. Throws KeyError if it is none.
  explicit Authority(std::filesystem::path folder);

  /// Makes the keys of a member, and returns its folder. Throws KeyError.
  std::filesystem::path add(const NewMember& member) const;
  /// Revokes the certificate of a member, and writes the new list of revoked certificates into the folders of all
  /// members. Throws KeyError, also if the folder of one member cannot get the list; then the others have it.
  void revoke(const std::string& name) const;
  /// Returns the member of this name; none if there is none, or if its folder has no certificate. Throws KeyError.
  [[nodiscard]] std::optional<Member> find(const std::string& name) const;
  /// Returns the names of all member folders, sorted, also of those without a certificate.
  [[nodiscard]] std::vector<std::string> names() const;
  [[nodiscard]] std::filesystem::path folder_of(const std::string& name) const;
  /// Copies the folder of a member to the new folder `to`, with the newest list of revoked certificates, if a program
  /// can use it. Only its owner can read the copy. Throws KeyError; then, or if it is killed, there is no folder `to`.
  void export_member(const std::string& name, const std::filesystem::path& to) const;
  [[nodiscard]] RevokedKeys revoked() const;
  /// Returns when the authority expires, and all its keys with it.
  [[nodiscard]] std::time_t valid_until() const;

 private:
  void revoke_certificate(const std::string& name) const;
  void write_revoked(const std::vector<std::string>& serials) const;
  void remove_remains() const;

  std::filesystem::path folder_;
};

}  // namespace tactus::keys
