#include "wire/transport/removals.hpp"

#include <algorithm>
#include <optional>

namespace tactus::wire {
namespace {

// A parameter of a vendor (bit 15). Bit 14 is 0: a library that does not know the parameter skips it.
constexpr std::uint32_t kRemovals = 0xb7ac;
constexpr std::uint32_t kParameterHead = 4;

void append(std::vector<std::uint8_t>& to, std::uint64_t number, std::uint32_t bytes, bool little_endian) {
  for (std::uint32_t i = 0; i < bytes; ++i)
    to.push_back(static_cast<std::uint8_t>(number >> 8u * (little_endian ? i : bytes - 1 - i)));
}

}  // namespace

std::vector<std::uint8_t> with_removals(const std::uint8_t* message, std::uint32_t size,
                                        const std::vector<GuidPrefix>& removed) {
  const std::optional<Announcement> found = announcement_in(message, size);
  if (!found || found->data.payload.size == 0) return {};
  ParameterList parameters = parameters_of(found->data.payload);
  const bool little_endian = parameters.rest().little_endian;
  const std::uint8_t* sentinel = parameters.rest().at;
  while (parameters.next()) sentinel = parameters.rest().at;

  const std::size_t count = std::min(removed.size(), kMaxNamedRemovals);
  const std::size_t value_size = count * sizeof(GuidPrefix);
  std::vector<std::uint8_t> made{message, sentinel};
  append(made, kRemovals, 2, little_endian);
  append(made, value_size, 2, little_endian);
  for (std::size_t i = 0; i < count; ++i) made.insert(made.end(), removed[i].begin(), removed[i].end());
  made.insert(made.end(), sentinel, message + size);
  if (found->submessage.last) return made;  // without a length, it extends to the end of the message
  constexpr std::uint32_t kLengthBeforeBody = 2;
  std::vector<std::uint8_t> length;
  append(length, found->submessage.body.size + kParameterHead + value_size, 2, found->submessage.body.little_endian);
  std::copy(length.begin(), length.end(), made.begin() + (found->submessage.body.at - message) - kLengthBeforeBody);
  return made;
}

bool names_removal_of(const GuidPrefix& participant, const std::uint8_t* message, std::uint32_t size) noexcept {
  const std::optional<Announcement> found = announcement_in(message, size);
  if (!found) return false;
  ParameterList parameters = parameters_of(found->data.payload);
  while (const auto parameter = parameters.next()) {
    if (parameter->id != kRemovals) continue;
    for (RtpsBytes names = parameter->value; names.size >= participant.size(); names = names.from(sizeof participant))
      if (std::equal(participant.begin(), participant.end(), names.at)) return true;
  }
  return false;
}

}  // namespace tactus::wire
