#include "wire/transport/trimming.hpp"

#include <algorithm>
#include <optional>

namespace tactus::wire {

bool trim(const std::uint8_t* message, std::uint32_t size, TrimmedMessage& out) noexcept {
  if (size + kMaxPadding > out.bytes.size()) return false;
  std::optional<Submessage> part = submessage_at(message, size, kRtpsHeader);
  const bool has_destination = part && part->id == kInfoDestinationId;
  if (has_destination) part = submessage_at(message, size, part->next);
  if (!part || part->id != kInfoTimeId) return false;
  const std::uint32_t begin = part->next;
  std::uint32_t end = size;
  if (const std::optional<EncryptedSubmessage> encrypted = encrypted_at(message, size, begin)) {
    end = encrypted->postfix.next;
  } else {
    part = submessage_at(message, size, begin);
    const std::optional<RtpsData> data = part ? data_of(*part) : std::nullopt;
    if (!data || (data->is_built_in() && !has_destination)) return false;
    end = part->next;
  }
  if (end > size || end + kStatisticsSize != size || message[end] != kStatisticsId) return false;

  auto to = std::copy(message, message + kRtpsHeader, out.bytes.begin());
  to = std::copy(message + begin, message + end, to);
  out.size = pad_if_it_looks_like_statistics(out.bytes.data(), static_cast<std::uint32_t>(to - out.bytes.begin()));
  return true;
}

}  // namespace tactus::wire
