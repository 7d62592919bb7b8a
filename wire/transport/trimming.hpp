/// Removes from messages of user topics the submessages that no reader uses.
///
/// Debian's build of Fast DDS appends 60 bytes of statistics to each message, and puts destination and time, 28 bytes,
/// before each sample. Receivers accept a message without destination, and Tactus does not use the library's sending
/// time. A trimmed message is standard RTPS.
///
/// Messages of discovery keep their times. Fast DDS stores the samples of several writers in the order of these times.
/// If some have none, a reliable reader may skip samples that arrive late (2.9.1: ReaderHistory::add_change and
/// History::get_change_nts), so that two endpoints never find each other. Readers of trimmed topics are best effort.
///
/// Measured (`strace -f -e trace=sendto,sendmsg tactus-latency run --link none`): the datagram of a probe state has 280
/// bytes. Calculated: without trimming it has 368 bytes, and a full chunk, which has 1,464 bytes when trimmed, needs a
/// second Ethernet frame.
#pragma once

#include <array>
#include <cstdint>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {

/// Max number of bytes by which a message of Fast DDS with one sample may exceed the largest datagram: the bytes of the
/// removed submessages, and bytes that Fast DDS reserves but a best-effort sample does not use (a heartbeat and the
/// longer header of a fragment).
inline constexpr std::uint32_t kMaxTrimmed = (kStatisticsSize - kSubmessageHeader) + 16 + 12 + (32 + 12);

struct TrimmedMessage {
  std::array<std::uint8_t, 2048> bytes;
  std::uint32_t size;
};

/// Trims a message that has these submessages: destination (optional), time, one sample, statistics. Time and sample
/// may be encrypted, each by itself. Returns false for a message to send unchanged: any other one, one that does not
/// fit `out`, and a plain sample of discovery. An encrypted sample of discovery looks like any other, so the caller
/// must not trim messages to ports of discovery.
[[nodiscard]] bool trim(const std::uint8_t* message, std::uint32_t size, TrimmedMessage& out) noexcept;

}  // namespace tactus::wire
