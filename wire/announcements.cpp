#include "wire/announcements.hpp"

#include <fastrtps/utils/IPLocator.h>

#include <algorithm>
#include <array>

namespace tactus::wire {
namespace {

using eprosima::fastrtps::rtps::IPLocator;

// RTPS 2.2, 8.3.3 and 9.4: the header of a message; id, flags and length of each submessage; what a sample begins with.
constexpr std::uint32_t kHeader = 20, kSubmessage = 4, kWriterId = 8, kSequence = 12, kSampleHeader = 20;
constexpr std::uint8_t kDataId = 0x15;
constexpr std::array<std::uint8_t, 4> kAnnouncer{0x00, 0x01, 0x00, 0xc2};  // the writer of participants (9.3.1.5)
constexpr std::size_t kManySent = 4096;

}  // namespace

std::optional<std::uint64_t> Announcements::sequence_of(const std::uint8_t* message, std::uint32_t size) {
  for (std::uint32_t at = kHeader; at + kSubmessage <= size;) {
    const std::uint8_t* const body = message + at + kSubmessage;
    const bool little = (message[at + 1] & 1u) != 0;
    const auto number = [&](const std::uint8_t* from, std::uint32_t bytes) {
      std::uint32_t value = 0;
      for (std::uint32_t i = 0; i < bytes; ++i) value = value << 8u | from[little ? bytes - 1 - i : i];
      return value;
    };
    const std::uint32_t length = number(message + at + 2, 2);
    if (message[at] == kDataId) {
      if (length < kSampleHeader || at + kSubmessage + kSampleHeader > size ||
          !std::equal(kAnnouncer.begin(), kAnnouncer.end(), body + kWriterId))
        return std::nullopt;
      return std::uint64_t{number(body + kSequence, 4)} << 32u | number(body + kSequence + 4, 4);
    }
    if (length == 0) return std::nullopt;  // the last one
    at += kSubmessage + length;
  }
  return std::nullopt;
}

std::vector<Announcements::Locator> Announcements::due(const void* sender, std::uint64_t sequence,
                                                       const std::vector<Locator>& to, std::int64_t now_ns) {
  const auto is_group = [](const Locator& locator) { return IPLocator::isMulticast(locator); };
  const bool has_group = std::any_of(to.begin(), to.end(), is_group);
  std::vector<Locator> due;
  const std::lock_guard<std::mutex> lock{mutex_};
  if (sent_.size() > kManySent) sent_.clear();
  for (const Locator& locator : to) {
    const std::int64_t rest_ns = has_group && !is_group(locator) ? kKnownRestNs : kGroupRestNs;
    const auto [at, first] = sent_.try_emplace({sender, locator}, Sent{sequence, now_ns});
    if (!first && at->second.sequence == sequence && now_ns - at->second.time_ns < rest_ns) continue;
    at->second = {sequence, now_ns};
    due.push_back(locator);
  }
  return due;
}

}  // namespace tactus::wire
