/// The submessages of an RTPS message as it came, read without trust in any length (RTPS 2.2, 8.3.3 and 9.4).
#pragma once

#include <cstdint>
#include <optional>

namespace tactus::wire {

inline constexpr std::uint32_t kRtpsHeader = 20;     ///< bytes before the first submessage
inline constexpr std::uint32_t kSubmessageHead = 4;  ///< id, flags, length
inline constexpr std::uint8_t kPadId = 0x01, kInfoTimeId = 0x09, kInfoDestinationId = 0x0e, kDataId = 0x15;
inline constexpr std::uint8_t kStatisticsId = 0x80;  ///< of the vendor, in Debian's build

/// One submessage; `body` is `size` bytes behind its head, all inside the message.
struct Submessage {
  const std::uint8_t* body;
  std::uint32_t size;
  std::uint8_t id, flags;
  bool last;           ///< its length is 0, which means the rest of the message
  std::uint32_t next;  ///< where the next one begins in the message, if any
  [[nodiscard]] bool little_endian() const noexcept { return (flags & 1u) != 0; }
};

/// The one that begins at byte `at`; none when no head fits there. One that is longer than the message ends with it.
[[nodiscard]] std::optional<Submessage> submessage_at(const std::uint8_t* message, std::uint32_t size,
                                                      std::uint32_t at) noexcept;

/// A message that goes out with something that looks like such statistics at its end, which they always are there: the
/// library fills them in, and takes them off where it arrives. Paddings move it: the size with these, kMostPaddings
/// bytes more at most, for which there is room. `size` is a multiple of four.
inline constexpr std::uint32_t kStatisticsSize = 60, kMostPaddings = 64;
[[nodiscard]] std::uint32_t pad_what_looks_like_statistics(std::uint8_t* message, std::uint32_t size) noexcept;

/// How much of a message comes before the first statistics of the library in it; all of it when there are none. Nobody
/// here reads them, and where they are not the last of a message the library, which Debian builds with assertions, ends
/// the process.
[[nodiscard]] std::uint32_t size_without_statistics(const std::uint8_t* message, std::uint32_t size) noexcept;

}  // namespace tactus::wire
