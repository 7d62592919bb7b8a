#include "wire/transport/rtps_message.hpp"

#include <algorithm>

namespace tactus::wire {
namespace {

constexpr std::uint32_t kSenderAt = 8;  // after magic, version and vendor
// Offsets in a DATA submessage, from the end of its header.
constexpr std::uint32_t kToInlineQosAt = 2, kWriterAt = 8, kSequenceAt = 12, kDataHead = 20;
constexpr std::uint8_t kInlineQosFlag = 0x02, kDataFlag = 0x04;
constexpr std::uint32_t kParameterHead = 4, kEncapsulation = 4, kSentinel = 1;

}  // namespace

std::uint32_t RtpsBytes::number(std::uint32_t from, std::uint32_t bytes) const noexcept {
  std::uint32_t value = 0;
  for (std::uint32_t i = 0; i < bytes; ++i) value = value << 8u | at[from + (little_endian ? bytes - 1 - i : i)];
  return value;
}

RtpsBytes RtpsBytes::from(std::uint32_t from) const noexcept {
  const std::uint32_t skipped = std::min(from, size);
  return {at + skipped, size - skipped, little_endian};
}

std::optional<Submessage> submessage_at(const std::uint8_t* message, std::uint32_t size, std::uint32_t at) noexcept {
  if (at > size || size - at < kSubmessageHeader) return std::nullopt;
  const std::uint8_t* const head = message + at;
  const bool little_endian = (head[1] & 1u) != 0;
  const RtpsBytes rest{head, size - at, little_endian};
  Submessage found{head[0], head[1], rest.from(kSubmessageHeader), false, size};
  const std::uint32_t length = rest.number(2, 2);
  found.last = length == 0 && found.id != kPadId && found.id != kInfoTimeId;
  if (found.last) return found;
  found.body.size = std::min(found.body.size, length);
  constexpr std::uint32_t kAlignment = 4;
  found.next = at + kSubmessageHeader + (length + kAlignment - 1) / kAlignment * kAlignment;
  return found;
}

std::optional<Submessage> find_submessage(const std::uint8_t* message, std::uint32_t size, std::uint8_t id) noexcept {
  std::uint32_t at = kRtpsHeader;
  while (const std::optional<Submessage> found = submessage_at(message, size, at)) {
    if (found->id == id) return found;
    if (found->last) break;
    at = found->next;
  }
  return std::nullopt;
}

std::optional<EncryptedSubmessage> encrypted_at(const std::uint8_t* message, std::uint32_t size,
                                                std::uint32_t at) noexcept {
  const std::optional<Submessage> prefix = submessage_at(message, size, at);
  if (!prefix || prefix->id != kSecurePrefixId || prefix->last) return std::nullopt;
  const std::optional<Submessage> body = submessage_at(message, size, prefix->next);
  if (!body || body->id != kSecureBodyId || body->last) return std::nullopt;
  const std::optional<Submessage> postfix = submessage_at(message, size, body->next);
  if (!postfix || postfix->id != kSecurePostfixId) return std::nullopt;
  return EncryptedSubmessage{*prefix, *body, *postfix};
}

GuidPrefix sender_of(const std::uint8_t* message) noexcept {
  GuidPrefix sender;
  std::copy_n(message + kSenderAt, sender.size(), sender.begin());
  return sender;
}

std::optional<RtpsData> data_of(const Submessage& submessage) noexcept {
  const RtpsBytes& body = submessage.body;
  if (submessage.id != kDataId || body.size < kDataHead) return std::nullopt;
  RtpsData data{};
  std::copy_n(body.at + kWriterAt, data.writer.size(), data.writer.begin());
  data.sequence = std::uint64_t{body.number(kSequenceAt, 4)} << 32u | body.number(kSequenceAt + 4, 4);
  data.payload = body.from(kToInlineQosAt + 2 + body.number(kToInlineQosAt, 2));
  data.inline_qos = data.payload.from(data.payload.size);
  if ((submessage.flags & kInlineQosFlag) != 0) {
    data.inline_qos = data.payload;
    ParameterList inline_qos{data.payload};
    while (inline_qos.next()) {
    }
    data.payload = inline_qos.rest();
  }
  if ((submessage.flags & kDataFlag) == 0) data.payload.size = 0;
  return data;
}

std::optional<Announcement> announcement_in(const std::uint8_t* message, std::uint32_t size) noexcept {
  const std::optional<Submessage> found = find_submessage(message, size, kDataId);
  const std::optional<RtpsData> data = found ? data_of(*found) : std::nullopt;
  if (!data || data->writer != kAnnouncements) return std::nullopt;
  return Announcement{*found, *data};
}

std::optional<ParameterList::Parameter> ParameterList::next() noexcept {
  if (ended_ || rest_.size < kParameterHead) return std::nullopt;
  const std::uint32_t id = rest_.number(0, 2), length = rest_.number(2, 2);
  ended_ = id == kSentinel;
  const RtpsBytes after_head = rest_.from(kParameterHead);
  if (ended_) {
    rest_ = after_head;
    return std::nullopt;
  }
  ended_ = length > after_head.size;
  rest_ = after_head.from(length);
  if (ended_) return std::nullopt;
  return Parameter{id, {after_head.at, length, after_head.little_endian}};
}

ParameterList parameters_of(const RtpsBytes& payload) noexcept {
  RtpsBytes list = payload.from(kEncapsulation);
  list.little_endian = payload.size >= 2 && (payload.at[1] & 1u) != 0;
  return ParameterList{list};
}

std::uint32_t pad_if_it_looks_like_statistics(std::uint8_t* message, std::uint32_t size) noexcept {
  constexpr std::array<std::uint8_t, kSubmessageHeader> kPad{kPadId, 1, 0, 0};  // the shortest submessage
  while (size >= kStatisticsSize && message[size - kStatisticsSize] == kStatisticsId) {
    std::copy(kPad.begin(), kPad.end(), message + size);
    size += kSubmessageHeader;
  }
  return size;
}

std::uint32_t size_without_statistics(const std::uint8_t* message, std::uint32_t size) noexcept {
  const std::optional<Submessage> statistics = find_submessage(message, size, kStatisticsId);
  return statistics ? static_cast<std::uint32_t>(statistics->body.at - message) - kSubmessageHeader : size;
}

}  // namespace tactus::wire
