#include "wire/transport/protection.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <string>
#include <string_view>

#include "wire/transport/rtps_message.hpp"

namespace tactus::wire {
namespace {

// Sizes in an encrypted submessage (DDS Security 1.1, 9.5.2.3).
constexpr std::uint32_t kPrefixSize = 20, kKeyAt = 4, kKeySize = 4;
constexpr std::array<std::uint8_t, 4> kAesGcm256{0, 0, 0, 4};  // the kind of all keys of the library
constexpr std::uint32_t kCommonMac = 16, kMac = 20;

constexpr std::string_view kCertificateProperty = "c.id";  // property of a handshake (DDS Security 1.1, 9.3.2.5)

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

/// Returns whether the encrypted bytes are inside of their submessage. The library does not check it.
bool is_complete(const Submessage& body) {
  if (body.body.size < 4) return false;
  RtpsBytes length = body.body;
  length.little_endian = false;
  return length.number(0, 4) <= body.body.size - 4;
}

bool is_of(const GuidPrefix& sender, const std::uint8_t* guid) {
  return std::equal(sender.begin(), sender.end(), guid);
}

/// Calls `visit` with the value of each binary property of this name in a message of the authentication. Returns false
/// if the name occurs in another form. The library reads a name of this length without its last byte, whatever that is.
template <class Visit>
bool visit_property(const RtpsBytes& payload, std::string_view name, const Visit& visit) {
  constexpr std::uint32_t kNumber = 4;
  const auto letters = static_cast<std::uint32_t>(name.size()), length = letters + 1;  // with the zero
  const std::uint32_t padded = (length + 3) / 4 * 4;
  std::string text(kNumber, '\0');
  text[payload.little_endian ? 0 : kNumber - 1] = static_cast<char>(length);
  text += name;
  const auto* const end = payload.at + payload.size;
  for (const auto* at = payload.at;; ++at) {
    at = std::search(at, end, text.begin(), text.end());
    if (at == end) return true;
    const auto from = static_cast<std::uint32_t>(at - payload.at) + kNumber;
    const RtpsBytes rest = payload.from(from);
    if (from % 4 != 0 || rest.size < padded + kNumber || rest.at[letters] != 0) return false;
    const std::uint32_t size = rest.number(padded, kNumber);
    RtpsBytes value = rest.from(padded + kNumber);
    if (size > value.size) return false;
    value.size = size;
    if (!visit(value)) return false;
  }
}

/// The payload of a message of the authentication, with the byte order of its encapsulation.
RtpsBytes in_its_byte_order(RtpsBytes payload) {
  payload.little_endian = (payload.at[1] & 1u) != 0;
  return payload;
}

/// Returns whether the participant data of a handshake states the GUID of its sender. The library uses the first key
/// hash or GUID, and rounds lengths up.
bool states_sender(RtpsBytes data, const GuidPrefix& sender) {
  constexpr std::uint32_t kAlignment = 4;
  data.little_endian = false;
  ParameterList parameters{data};
  int guids = 0;
  while (const auto parameter = parameters.next()) {
    const RtpsBytes& value = parameter->value;
    if (parameter->id == kKeyHashParameter || value.size % kAlignment != 0) return false;
    if (parameter->id != kGuidParameter) continue;
    if (value.size < sender.size() || !is_of(sender, value.at)) return false;
    ++guids;
  }
  return guids == 1;
}

/// Returns whether a message of the authentication speaks for its sender (ParticipantGenericMessage, DDS Security 1.1,
/// 7.4.3 and 9.3.2.5).
bool is_of_sender(RtpsBytes payload, const GuidPrefix& sender) {
  constexpr std::uint32_t kEncapsulation = 4, kFixedPart = 96;
  if (payload.size < kEncapsulation + kFixedPart) return false;
  payload = in_its_byte_order(payload);
  if (!is_of(sender, payload.at + kEncapsulation)) return false;
  int certificates = 0, participants = 0;
  const bool has_its_form =
      visit_property(payload, kCertificateProperty, [&](const RtpsBytes&) { return ++certificates > 0; }) &&
      visit_property(payload, "c.pdata", [&](const RtpsBytes& data) {
        ++participants;
        return states_sender(data, sender);
      });
  return has_its_form && certificates == participants && certificates <= 1;
}

/// Inline QoS can state that the participant has left. The library itself sends only the announcement to which one
/// answers, Fast DDS 3 also by its standard name.
bool is_harmless(const RtpsBytes& inline_qos) {
  constexpr std::uint32_t kAnsweredOfFastDds = 0x800f, kAnswered = 0x0083, kAlignment = 4;
  ParameterList parameters{inline_qos};
  while (const auto parameter = parameters.next())
    if ((parameter->id != kAnsweredOfFastDds && parameter->id != kAnswered) || parameter->value.size % kAlignment != 0)
      return false;
  return true;
}

Refusal refusal_of_data(const Submessage& submessage, const GuidPrefix& sender) {
  const std::optional<RtpsData> data = data_of(submessage);
  if (!data) return Refusal::kMalformed;
  if (data->writer != kAuthentication && data->writer != kAnnouncements) return Refusal::kPlain;
  if (data->payload.size == 0 || !is_harmless(data->inline_qos)) return Refusal::kLeave;
  if (submessage.body.number(2, 2) != 16) return Refusal::kMalformed;  // bytes up to the payload
  if (data->writer == kAuthentication && !is_of_sender(data->payload, sender)) return Refusal::kOther;
  return Refusal::kNone;
}

}  // namespace

Refusal refusal_of(const std::uint8_t* message, std::uint32_t size) noexcept {
  if (size < kRtpsHeader) return Refusal::kMalformed;
  std::uint32_t at = kRtpsHeader;
  bool has_content = false;
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
        if (const Refusal refusal = refusal_of_data(*part, sender_of(message)); refusal != Refusal::kNone)
          return refusal;
        has_content = true;
        break;
      case kSecurePrefixId: {
        const std::optional<EncryptedSubmessage> encrypted = encrypted_at(message, size, at);
        if (!encrypted || encrypted->prefix.body.size < kPrefixSize || !is_complete(encrypted->body) ||
            !std::equal(kAesGcm256.begin(), kAesGcm256.end(), encrypted->prefix.body.at))
          return Refusal::kMalformed;
        if (!is_key_exchange(encrypted->prefix) && proofs_in(encrypted->postfix) == 0) return Refusal::kNoOrigin;
        part = encrypted->postfix;
        has_content = true;
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
  return has_content ? Refusal::kNone : Refusal::kMalformed;
}

RtpsBytes certificate_in(const RtpsBytes& handshake) noexcept {
  RtpsBytes certificate = handshake.from(handshake.size);
  if (handshake.size < 2) return certificate;
  (void)visit_property(in_its_byte_order(handshake), kCertificateProperty, [&](const RtpsBytes& value) {
    certificate = value;
    return true;
  });
  return certificate;
}

}  // namespace tactus::wire
