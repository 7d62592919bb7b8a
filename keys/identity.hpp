/// The identity that a program states when it joins a secured session, and the proof that it is true.
///
/// A program announces itself in plain text, before anybody has authenticated it. The subject of its certificate
/// contains the same identity, and the GUIDs of its participants begin with a hash of that subject, which the
/// authentication checks (DDS Security 1.1, 9.3.3). So an identity is true if an authenticated GUID begins with its
/// hash.
#pragma once

#include <array>
#include <cstdint>
#include <ctime>
#include <optional>
#include <string>
#include <string_view>

#include "keys/member.hpp"

namespace tactus::keys {

struct Identity {
  Role role = Role::kObserver;
  std::string name;             ///< of the member
  std::string serial;           ///< of its certificate, hexadecimal
  std::time_t valid_until = 0;  ///< of its certificate
  Permitted permitted;
  std::string participant;  ///< name of the program in the session (is_name_of)
};

/// Several programs with the same keys are named NAME.INSTANCE. No other member can have such a name, because names of
/// members have no point.
[[nodiscard]] std::string instance_name(const std::string& member, const std::string& instance);
/// Returns whether the program of a member may have this name: that of the member, or NAME.INSTANCE.
[[nodiscard]] bool is_name_of(std::string_view participant, std::string_view member) noexcept;

/// Returns the identity of a program with these keys.
[[nodiscard]] Identity identity_of(const Member& member, std::string participant);

/// The text that a program announces, of at most 767 bytes.
[[nodiscard]] std::string text_of(const Identity& identity);
/// Returns the identity in a received text; none if it has characters that no authority issues, or if the name of the
/// program is not one that the member may use. Names of programs have letters, digits, hyphens, underscores and points.
[[nodiscard]] std::optional<Identity> read_identity(std::string_view text);

/// The first bytes of the GUIDs of all participants of a program with this identity, whose authority is `group`. Throws
/// KeyError if OpenSSL fails. Cost: some 10 us.
using GuidBegin = std::array<std::uint8_t, 6>;
[[nodiscard]] GuidBegin guid_begin_of(const std::string& group, const Identity& identity);

/// Returns whether a text is a certificate (PEM) of this identity, whose authority is `group`. Does not check who has
/// signed it. Throws KeyError if OpenSSL fails. Cost: some 50 us.
[[nodiscard]] bool is_certificate_of(std::string_view text, const std::string& group, const Identity& identity);

}  // namespace tactus::keys
