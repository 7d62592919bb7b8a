#include "wire/transport/trimming.hpp"

#include <algorithm>
#include <optional>

namespace tactus::wire {
namespace {

constexpr std::uint32_t kInfoTimeSize = 12;  // no other submessage of the library is so short

/// Bytes of the submessage that was encrypted. They have the same length, and a length field of four bytes before them.
std::uint32_t content_size(const EncryptedSubmessage& encrypted) {
  return encrypted.body.body.size < 4 ? 0 : encrypted.body.body.size - 4;
}

}  // namespace

bool trim(const std::uint8_t* message, std::uint32_t size, TrimmedMessage& out) noexcept {
  if (size + kMaxPadding > out.bytes.size()) return false;
  std::optional<Submessage> part = submessage_at(message, size, kRtpsHeader);
  const bool has_destination = part && part->id == kInfoDestinationId;
  const std::uint32_t time_at = has_destination ? part->next : kRtpsHeader;
  std::uint32_t begin = size, end = size;
  if (const std::optional<EncryptedSubmessage> time = encrypted_at(message, size, time_at)) {
    begin = time->postfix.next;
    const std::optional<EncryptedSubmessage> sample = encrypted_at(message, size, begin);
    if (content_size(*time) != kInfoTimeSize || !sample) return false;
    end = sample->postfix.next;
  } else {
    part = submessage_at(message, size, time_at);
    if (!part || part->id != kInfoTimeId) return false;
    begin = part->next;
    part = submessage_at(message, size, begin);
    const std::optional<RtpsData> data = part ? data_of(*part) : std::nullopt;
    if (!data || data->is_built_in()) return false;
    end = part->next;
  }
  if (end > size || end + kStatisticsSize != size || message[end] != kStatisticsId) return false;

  auto to = std::copy(message, message + kRtpsHeader, out.bytes.begin());
  to = std::copy(message + begin, message + end, to);
  out.size = pad_if_it_looks_like_statistics(out.bytes.data(), static_cast<std::uint32_t>(to - out.bytes.begin()));
  return true;
}

}  // namespace tactus::wire
