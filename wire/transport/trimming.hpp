/// Shortens the messages of user topics by what none of their readers uses.
///
/// Debian's build of Fast DDS ends each message with 60 bytes of statistics, and precedes each sample by its
/// destination and its time, 28 bytes. A receiver that finds no destination takes the message for its own, and nothing
/// here asks for the time at which the library sent a sample. What is left is standard RTPS.
/// Figure: a probe state leaves in a datagram of 280 bytes
/// (`strace -f -e trace=sendto,sendmsg tactus-latency run --link none`). Calculated, not measured: the library made 88
/// bytes more, and a full chunk of a mesh, 1,468 bytes, would need a second frame with them.
#pragma once

#include <array>
#include <cstdint>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {

/// How much larger than a datagram Fast DDS may make a message that has only one sample. It counts the submessages that
/// are trimmed, and reserves a heartbeat and the longer header of a fragment, which best-effort samples do not have.
inline constexpr std::uint32_t kTrimmedAtMost = (kStatisticsSize - kSubmessageHead) + 16 + 12 + (32 + 12);

/// A message that was trimmed.
struct TrimmedMessage {
  std::array<std::uint8_t, 2048> bytes;
  std::uint32_t size;
};

/// Trims a message that consists of destination (optional), time, one sample and statistics, in this order. False when
/// it consists of something else, does not fit, or is a sample of discovery to everyone: then it goes out as it is.
[[nodiscard]] bool trim(const std::uint8_t* message, std::uint32_t size, TrimmedMessage& out) noexcept;

}  // namespace tactus::wire
