/// Refuses the messages that a participant with keys must not process, because Fast DDS does not refuse them.
///
/// Fast DDS decrypts protected messages, but also processes plain ones, although the governance demands protection
/// (versions 2.9.1 and 3.1.2 in src/cpp/rtps/messages/MessageReceiver.cpp; 3.1 refuses plain samples, but only if
/// submessages are protected). A plain message that names a member as its sender then counts as one of this member. It
/// also accepts a submessage without proof of its origin, although the governance demands this proof, so that every
/// member could send as another (src/cpp/security/cryptography/AESGCMGMAC_Transform.cpp, deserialize_SecureDataTag).
///
/// A message of the authentication must speak for its sender: the library checks that the certificate matches the GUID
/// in the handshake (c.pdata), but not that this is the GUID of the participant that it authenticates.
///
/// Of the plain submessages with data, only the announcements of participants and the messages of the authentication
/// are accepted, because DDS Security cannot encrypt them.
///
/// A message without data and without an encrypted submessage is refused: the library would renew the lease of the
/// participant that it names as its sender.
#pragma once

#include <cstdint>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {

enum class Refusal : std::uint8_t {
  kNone,
  kPlain,  ///< the message has a submessage that must be encrypted
  /// A plain control message of RTPS. The library sends some from endpoints of discovery that it does not use.
  kControl,
  kNoOrigin,  ///< an encrypted submessage has no proof of its origin for any receiver
  /// A plain message states that a participant has left (CVE-2023-50257). The library sends one when its participant
  /// ends.
  kLeave,
  kOther,     ///< a message of the authentication speaks for another participant than its sender
  kMalformed  ///< no RTPS message, one without content, or a submessage that is incomplete or has another form than the
              ///< library sends
};

/// Returns why a participant with keys must not process this message. Never reads outside of the message. Cost: some
/// nanoseconds for each submessage.
[[nodiscard]] Refusal refusal_of(const std::uint8_t* message, std::uint32_t size) noexcept;

/// Returns the certificate (PEM) that a message of the authentication states; empty if it states none. `handshake`:
/// payload of a message that refusal_of lets pass.
[[nodiscard]] RtpsBytes certificate_in(const RtpsBytes& handshake) noexcept;

}  // namespace tactus::wire
