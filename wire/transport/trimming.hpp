/// Removes the submessages of user topics that no reader uses.
///
/// Debian's build of Fast DDS appends 60 bytes of statistics to each message, and puts destination and time, 28 bytes,
/// before each sample. A receiver accepts a message without destination, and Tactus does not use the library's sending
/// time. The result is standard RTPS.
/// Figure: a probe state is sent in a datagram of 280 bytes
/// (`strace -f -e trace=sendto,sendmsg tactus-latency run --link none`). Calculated, not measured: without trimming it
/// has 88 bytes more, and a full chunk of a mesh, 1,468 bytes, would need a second Ethernet frame.
#pragma once

#include <array>
#include <cstdint>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {

/// Max bytes by which Fast DDS may exceed a datagram in a message with one sample. It counts the submessages that are
/// removed, and reserves a heartbeat and the longer header of a fragment, which best-effort samples do not have.
inline constexpr std::uint32_t kMaxTrimmed = (kStatisticsSize - kSubmessageHeader) + 16 + 12 + (32 + 12);

/// A message that was trimmed.
struct TrimmedMessage {
  std::array<std::uint8_t, 2048> bytes;
  std::uint32_t size;
};

/// Trims a message of destination (optional), time, one sample and statistics, in this order. Returns false for other
/// messages, for messages that do not fit, and for discovery samples to everyone; these are sent unchanged.
[[nodiscard]] bool trim(const std::uint8_t* message, std::uint32_t size, TrimmedMessage& out) noexcept;

}  // namespace tactus::wire
