/// DDS Security for a participant.
#pragma once

#include <filesystem>

#include "keys/member.hpp"
#include "wire/dds.hpp"

namespace tactus::wire {

/// The handshake between two participants needs messages of some 5 KB, and cannot divide them. So the messages of a
/// secured participant are larger than a frame, and the network divides them.
inline constexpr std::uint32_t kSecuredMessageBytes = 16384;

/// Bytes that protection adds to a message with one sample: 56 for encryption, 20 for the proof of its origin to each
/// reader, and up to 3 of padding. Enough for three readers.
inline constexpr std::uint32_t kProtectionBytes = 56 + 3 * 20 + 4;

/// Reads the keys of a folder. Throws WireError if they cannot be used now.
[[nodiscard]] keys::Member read_keys(const std::filesystem::path& folder);

/// Lets the participant use these keys: only members of their authority match, and all messages are encrypted.
void secure(const std::filesystem::path& folder, dds::DomainParticipantQos& qos);

}  // namespace tactus::wire
