#include "wire/transport/protection.hpp"

#include <algorithm>
#include <array>
#include <optional>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {
namespace {

using EntityId = std::array<std::uint8_t, 4>;
constexpr EntityId kAnnouncements{0x00, 0x01, 0x00, 0xc2}, kAuthentication{0x00, 0x02, 0x01, 0xc3};

// Sizes in an encrypted submessage (DDS Security 1.1, 9.5.2.3).
constexpr std::uint32_t kPrefixSize = 20, kKeyAt = 4, kKeySize = 4;
constexpr std::uint32_t kCommonMac = 16, kMac = 20;

/// The exchange of keys between two participants uses a key that only these two have. Its number is 0.
bool is_key_exchange(const Submessage& prefix) {
  const std::uint8_t* const key = prefix.body.at + kKeyAt;
  return std::all_of(key, key + kKeySize, [](std::uint8_t byte) { return byte == 0; });
}

/// Returns the number of receivers for which the submessage has a proof of its origin.
std::uint32_t proofs_in(const Submessage& postfix) {
  if (postfix.body.size < kCommonMac + 4) return 0;
  RtpsBytes count = postfix.body.from(kCommonMac);
  count.little_endian = false;
  return std::min(count.number(0, 4), count.from(4).size / kMac);
}

Refusal refusal_of_data(const Submessage& submessage) {
  const std::optional<RtpsData> data = data_of(submessage);
  if (!data) return Refusal::kMalformed;
  if (data->writer == kAuthentication) return Refusal::kNone;
  if (data->writer != kAnnouncements) return Refusal::kPlain;
  return data->payload.size != 0 ? Refusal::kNone : Refusal::kLeave;
}

}  // namespace

Refusal refusal_of(const std::uint8_t* message, std::uint32_t size) noexcept {
  if (size < kRtpsHeader) return Refusal::kMalformed;
  std::uint32_t at = kRtpsHeader;
  while (at < size) {
    std::optional<Submessage> part = submessage_at(message, size, at);
    if (!part) return Refusal::kMalformed;
    switch (part->id) {
      case kPadId:
      case kInfoTimeId:
      case kInfoDestinationId:
      case kStatisticsId:
        break;
      case kDataId:
        if (const Refusal refusal = refusal_of_data(*part); refusal != Refusal::kNone) return refusal;
        break;
      case kSecurePrefixId: {
        const std::optional<EncryptedSubmessage> encrypted = encrypted_at(message, size, at);
        if (!encrypted || encrypted->prefix.body.size < kPrefixSize) return Refusal::kMalformed;
        if (!is_key_exchange(encrypted->prefix) && proofs_in(encrypted->postfix) == 0) return Refusal::kNoOrigin;
        part = encrypted->postfix;
        break;
      }
      case kAckNackId:
      case kHeartbeatId:
      case kGapId:
        return Refusal::kControl;
      default:
        return Refusal::kPlain;
    }
    if (part->last) break;
    at = part->next;
  }
  return Refusal::kNone;
}

}  // namespace tactus::wire
