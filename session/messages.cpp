#include "session/messages.hpp"

#include <xxhash.h>

#include <array>

namespace tactus::session {

const char* role_name(Role role) noexcept {
  switch (role) {
    case Role::kHost:
      return "host";
    case Role::kHrtc:
      return "hrtc";
    case Role::kClient:
      return "client";
    case Role::kViewer:
      return "viewer";
  }
  return "unknown";
}

std::uint64_t id_of(const std::string& name) noexcept { return XXH3_64bits(name.data(), name.size()); }

std::uint32_t stream_id(const Origin& host, const Origin& hrtc, std::uint64_t object_id) noexcept {
  const std::array<std::uint64_t, 6> names{host.session,     host.participant, host.incarnation,
                                           hrtc.participant, hrtc.incarnation, object_id};
  return static_cast<std::uint32_t>(XXH3_64bits(names.data(), sizeof names));
}

std::size_t header_bytes(std::uint32_t region, std::uint32_t count) noexcept {
  const auto varint = [](std::uint64_t value) {
    std::size_t bytes = 1;
    for (; value >= 0x80; value >>= 7) ++bytes;
    return bytes;
  };
  return varint(std::uint64_t{region} + 1) + 2 * varint(count) + varint(kMaxPayload) + sizeof(BulkPiece::checksum);
}

std::size_t BulkChunk::payload_bytes() const noexcept {
  std::size_t bytes = 0;
  for (const BulkPiece& piece : pieces) bytes += piece.payload.size();
  return bytes;
}

std::uint32_t checksum_of(std::span<const std::uint8_t> payload) noexcept {
  return static_cast<std::uint32_t>(XXH3_64bits(payload.data(), payload.size()));
}

const char* fault_reason(std::uint32_t status) noexcept {
  if ((status & kFault) == 0) return "";
  switch ((status & kFaultReason) >> kFaultReasonShift) {
    case 1:
      return "a pose or a surface had a value that is not finite";
    case 2:
      return "the force would not have been a number";
    case 3:
      return "the device failed";
    case 4:
      return "emergency stop";
    case 5:
      return "the tip moved too fast against a force";
    case 6:
      return "the haptic thread was overloaded";
    default:
      return "unknown";
  }
}

}  // namespace tactus::session
