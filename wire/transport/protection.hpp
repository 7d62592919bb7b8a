/// Refuses the messages that a participant with keys must not process, because Fast DDS does not refuse them.
///
/// Fast DDS decrypts protected messages, but also processes plain ones, although the governance demands protection
/// (versions 2.9.1 and 3.1.2 in src/cpp/rtps/messages/MessageReceiver.cpp; 3.1 refuses plain samples, but only if
/// submessages are protected). A plain message that names a member as its sender then counts as one of this member. It
/// also accepts a submessage without proof of its origin, although the governance demands this proof, so that every
/// member could send as another (src/cpp/security/cryptography/AESGCMGMAC_Transform.cpp, deserialize_SecureDataTag).
///
/// Plain are only the announcements of participants and the messages of the authentication, which cannot be encrypted.
#pragma once

#include <cstdint>

namespace tactus::wire {

enum class Refusal : std::uint8_t {
  kNone,
  kPlain,     ///< the message has a submessage that must be encrypted
  kControl,   ///< a plain acknowledgement or heartbeat; the library sends some of its unused endpoints for discovery
  kNoOrigin,  ///< an encrypted submessage has no proof of its origin for any receiver
  kLeave,     ///< a plain message states that a participant has left (CVE-2023-50257); the library sends one at its end
  kMalformed  ///< no RTPS message, or a submessage that is not complete
};

/// Returns why a participant with keys must not process this message. Never reads outside of the message. Cost: some
/// nanoseconds for each submessage.
[[nodiscard]] Refusal refusal_of(const std::uint8_t* message, std::uint32_t size) noexcept;

}  // namespace tactus::wire
