/// The keys of one program of a secured session.
///
/// `tactus keys` makes a folder for each member; its program takes the folder with --keys. A member is a program with a
/// role, and the certificate states both. DDS Security 1.1 defines the content of the files.
#pragma once

#include <cstdint>
#include <ctime>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace tactus::keys {

/// Thrown for folders and names that cannot be used. The message names the file, what was found and what was expected,
/// and the command that mends it.
class KeyError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class Role : std::uint32_t {
  kHost,      ///< serves objects
  kHrtc,      ///< computes forces, and publishes the states of its users
  kUser,      ///< brings users, who move their own hands only
  kOperator,  ///< may do what a user may, and reset forces and end the session
  kObserver,  ///< reads; writes only its presence, stops, and demands of a viewer
  kTester     ///< writes every topic, but only in sessions of `tactus latency`
};
inline constexpr Role kRoles[] = {Role::kHost,     Role::kHrtc,     Role::kUser,
                                  Role::kOperator, Role::kObserver, Role::kTester};
[[nodiscard]] std::string_view name_of(Role role) noexcept;

/// Names of the files in the folder of a member.
namespace files {
inline constexpr const char* kIdentityCa = "identity-ca.pem";
inline constexpr const char* kPermissionsCa = "permissions-ca.pem";
inline constexpr const char* kCertificate = "certificate.pem";
inline constexpr const char* kPrivateKey = "private-key.pem";
inline constexpr const char* kGovernance = "governance.p7s";
inline constexpr const char* kPermissions = "permissions.p7s";
inline constexpr const char* kRevoked = "revoked.pem";  ///< list of the revoked certificates
}  // namespace files

/// Names that restrict what a member may write; the certificate states them.
///
///     kUser, kOperator   the users that it brings
///     kHrtc              the users that it serves; empty: all
///     kHost              the objects that it offers and moves; empty: all
///     others             empty
using Permitted = std::vector<std::string>;
/// The names, separated by spaces. Names have no spaces.
[[nodiscard]] std::string text_of(const Permitted& permitted);
[[nodiscard]] Permitted permitted_in(std::string_view text);
/// Largest size of that text, bytes, so that an announcement fits one frame.
inline constexpr std::size_t kMaxPermitted = 511;

struct Member {
  std::string name;
  Role role = Role::kObserver;
  Permitted permitted;
  std::string group;  ///< name of the authority, the same for all members of a session
  std::time_t valid_from = 0, valid_until = 0;
  std::string serial;  ///< of the certificate, hexadecimal
  bool is_revoked = false;
};

/// Returns a time in UTC, of at most 31 characters. `format`: as of strftime().
[[nodiscard]] std::string utc_text(std::time_t time, const char* format = "%Y-%m-%d %H:%M:%S UTC");

/// Returns the command that makes new keys for a member, with the same permitted names. It works in the folder that has
/// the one of the authority, if that was not renamed.
[[nodiscard]] std::string replace_command(const Member& member);

/// Reads the folder of a member, and checks it as its program needs it: all files are there, the identity authority has
/// issued the certificate, the private key belongs to it and only its owner can read it, the permissions are those of
/// this certificate, and the certificate is valid at `now` and not revoked. Throws KeyError.
[[nodiscard]] Member read_member(const std::filesystem::path& folder, std::time_t now);

/// The list of revoked certificates.
struct RevokedKeys {
  std::vector<std::string> serials;  ///< hexadecimal
  std::time_t made = 0;              ///< when the authority has made the list; each list is newer than those before
};
/// Returns the list in the folder of a member. Throws KeyError if there is none, or that of another authority.
[[nodiscard]] RevokedKeys read_revoked(const std::filesystem::path& folder);
/// Returns a text such as '2 revoked keys, list of 2026-11-26 10:00:00 UTC'.
[[nodiscard]] std::string text_of(const RevokedKeys& revoked);
/// Returns what to do if the list was made with a wrong clock, after `now`; empty if it was not.
[[nodiscard]] std::string clock_warning(const RevokedKeys& revoked, std::time_t now);

}  // namespace tactus::keys
