/// Parses an RTPS message from the network without trusting any length (RTPS 2.2, sections 8.3 and 9.4).
#pragma once

#include <array>
#include <cstdint>
#include <optional>

namespace tactus::wire {

inline constexpr std::uint32_t kRtpsHeader = 20;       ///< bytes before the first submessage
inline constexpr std::uint32_t kSubmessageHeader = 4;  ///< header: id, flags, length
inline constexpr std::uint8_t kPadId = 0x01, kInfoTimeId = 0x09, kInfoDestinationId = 0x0e, kDataId = 0x15,
                              kAckNackId = 0x06, kHeartbeatId = 0x07, kGapId = 0x08;
inline constexpr std::uint8_t kSecureBodyId = 0x30, kSecurePrefixId = 0x31, kSecurePostfixId = 0x32;
inline constexpr std::uint8_t kStatisticsId = 0x80;  ///< a vendor's submessage that Debian's build of Fast DDS adds

/// A range of bytes in a message, and the byte order of its numbers.
struct RtpsBytes {
  const std::uint8_t* at;
  std::uint32_t size;
  bool little_endian;

  /// The unsigned number in the `bytes` bytes at offset `from`. The caller has checked the range.
  [[nodiscard]] std::uint32_t number(std::uint32_t from, std::uint32_t bytes) const noexcept;
  /// All bytes from offset `from` on; empty if `from` is after the end.
  [[nodiscard]] RtpsBytes from(std::uint32_t from) const noexcept;
};

struct Submessage {
  std::uint8_t id, flags;
  RtpsBytes body;      ///< lies inside the message, even if the submessage claims to be longer
  bool last;           ///< the length field is 0: the submessage extends to the end of the message
  std::uint32_t next;  ///< offset of the next submessage, if there is one
};

/// The submessage at offset `at`; none if the message has too few bytes after `at` for a submessage header.
[[nodiscard]] std::optional<Submessage> submessage_at(const std::uint8_t* message, std::uint32_t size,
                                                      std::uint32_t at) noexcept;

/// The first submessage with this id. The message must have at least kRtpsHeader bytes.
[[nodiscard]] std::optional<Submessage> find_submessage(const std::uint8_t* message, std::uint32_t size,
                                                        std::uint8_t id) noexcept;

/// An encrypted submessage: three submessages in a row (DDS Security 1.1, 9.5.2.3).
struct EncryptedSubmessage {
  Submessage prefix;  ///< names the key
  Submessage body;
  Submessage postfix;  ///< proves sender and content
};
/// The encrypted submessage at offset `at`; none if one of its three submessages is missing.
[[nodiscard]] std::optional<EncryptedSubmessage> encrypted_at(const std::uint8_t* message, std::uint32_t size,
                                                              std::uint32_t at) noexcept;

using GuidPrefix = std::array<std::uint8_t, 12>;
/// The participant that sent a message. The message must have at least kRtpsHeader bytes.
[[nodiscard]] GuidPrefix sender_of(const std::uint8_t* message) noexcept;

/// Entity id of a writer.
using EntityId = std::array<std::uint8_t, 4>;
inline constexpr EntityId kAnnouncements{0x00, 0x01, 0x00, 0xc2};   ///< of participants (9.3.1.5)
inline constexpr EntityId kAuthentication{0x00, 0x02, 0x01, 0xc3};  ///< handshakes (DDS Security 1.1, 7.4.2)
inline constexpr std::uint32_t kGuidParameter = 0x50;               ///< in an announcement: GUID of the participant
inline constexpr std::uint32_t kKeyHashParameter = 0x70;            ///< the library takes it for that GUID

/// The content of a DATA submessage (9.4.5.3).
struct RtpsData {
  EntityId writer;
  std::uint64_t sequence;
  RtpsBytes inline_qos;  ///< parameter list, with the payload after it; empty without inline QoS
  RtpsBytes payload;     ///< with its encapsulation header; empty if the sample has no data

  /// True for the writers of discovery and of vendors, false for writers of user topics (9.3.1.2).
  [[nodiscard]] bool is_built_in() const noexcept { return (writer[3] & 0xc0u) != 0; }
};
/// The content of `submessage`; none if it is no DATA submessage, or shorter than the fixed part of one.
[[nodiscard]] std::optional<RtpsData> data_of(const Submessage& submessage) noexcept;

/// The announcement of a participant in a message.
struct Announcement {
  Submessage submessage;
  RtpsData data;
};
/// The announcement in a message, if its first DATA submessage is one.
[[nodiscard]] std::optional<Announcement> announcement_in(const std::uint8_t* message, std::uint32_t size) noexcept;

/// Reads a parameter list (9.4.2.11), such as inline QoS or the payload of a discovery sample.
class ParameterList {
 public:
  struct Parameter {
    std::uint32_t id;
    RtpsBytes value;
  };
  explicit ParameterList(const RtpsBytes& list) noexcept : rest_{list} {}

  /// Reads the next parameter; none at the sentinel, or if the parameter extends beyond the list.
  [[nodiscard]] std::optional<Parameter> next() noexcept;
  /// The bytes after the parameters read so far; after the sentinel, the bytes after the list.
  [[nodiscard]] const RtpsBytes& rest() const noexcept { return rest_; }

 private:
  RtpsBytes rest_;
  bool ended_ = false;
};
/// The parameters in a payload, in the byte order that its encapsulation header states.
[[nodiscard]] ParameterList parameters_of(const RtpsBytes& payload) noexcept;

/// Adds PAD submessages to a message until the byte 60 before its end is not 0x80, and returns the new size.
///
/// Reason: if that byte is 0x80, Fast DDS assumes that the message has statistics. It overwrites the last 60 bytes when
/// it sends the message, and removes them when it receives the message. `size` must be a multiple of four, and the
/// buffer must have kMaxPadding more bytes.
inline constexpr std::uint32_t kStatisticsSize = 60, kMaxPadding = 64;
[[nodiscard]] std::uint32_t pad_if_it_looks_like_statistics(std::uint8_t* message, std::uint32_t size) noexcept;

/// The size of a message up to its first statistics submessage. Nothing uses the statistics, and Debian's Fast DDS,
/// which is built with assertions, aborts the process if they are not the last submessage.
[[nodiscard]] std::uint32_t size_without_statistics(const std::uint8_t* message, std::uint32_t size) noexcept;

}  // namespace tactus::wire
