/// Cryptography for each message of a secured session, without exclusive locks of OpenSSL (wire/session_keys.hpp).
///
/// This module also defines RAND_bytes of OpenSSL: libraries that call it, such as Fast DDS, get random bytes from the
/// kernel, and a program without random bytes ends. OpenSSL itself does not call it for its keys. A program cannot link
/// this module and a static libcrypto, which has the same function.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace tactus::keys {

/// A key or a salt. Master keys and salts have 16 or 32 bytes, then zeros; session keys have 32.
using MessageKey = std::array<std::uint8_t, 32>;

enum class KeyUse : std::uint8_t {
  kContent,  ///< of the content of messages
  kOrigin    ///< of the proof of origin for one receiver
};

/// Derives a session key of DDS Security from the master key of a writer or reader: HMAC-SHA-256 of a label, the salt
/// and the session id in the byte order of this machine. `key_bytes`: size of master key and salt, 16 or 32. Throws
/// KeyError if OpenSSL fails. Threads: any. Cost: 1 us.
/// Source: DDS Security 1.1, 9.5.3.3.3.
[[nodiscard]] MessageKey session_key(KeyUse use, const MessageKey& master, const MessageKey& salt,
                                     std::uint32_t session_id, std::size_t key_bytes);

}  // namespace tactus::keys
