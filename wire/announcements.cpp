#include "wire/announcements.hpp"

#include <fastrtps/utils/IPLocator.h>

#include <algorithm>
#include <array>
#include <iterator>

namespace tactus::wire {
namespace {

using eprosima::fastrtps::rtps::IPLocator;

// RTPS 2.2, 8.3.3 and 9.4: the header of a message, with who sends it; id, flags and length of each submessage; what a
// sample begins with, then its encapsulation and parameters.
constexpr std::uint32_t kHeader = 20, kSenderAt = 8, kSubmessage = 4, kWriterAt = 8, kSequenceAt = 12;
constexpr std::uint32_t kSampleHeader = 20, kEncapsulation = 4, kParameter = 4, kLocator = 24;
constexpr std::uint8_t kDataId = 0x15, kInlineQos = 0x02;
constexpr std::uint32_t kMetatrafficUnicast = 0x32;                        // a parameter (9.6.2)
constexpr std::array<std::uint8_t, 4> kAnnouncer{0x00, 0x01, 0x00, 0xc2};  // the writer of participants (9.3.1.5)
constexpr std::size_t kMany = 4096;

struct Bytes {
  const std::uint8_t* at;
  std::uint32_t size;
  bool little;
  [[nodiscard]] std::uint32_t number(std::uint32_t from, std::uint32_t bytes) const {
    std::uint32_t value = 0;
    for (std::uint32_t i = 0; i < bytes; ++i) value = value << 8u | at[from + (little ? bytes - 1 - i : i)];
    return value;
  }
};

/// The sample of a message that announces a participant.
std::optional<Bytes> announcement_of(const std::uint8_t* message, std::uint32_t size, bool& inline_qos) {
  for (std::uint32_t at = kHeader; at + kSubmessage <= size;) {
    const Bytes submessage{message + at, size - at, (message[at + 1] & 1u) != 0};
    const std::uint32_t length = submessage.number(2, 2);
    if (message[at] == kDataId) {
      const Bytes sample{submessage.at + kSubmessage, std::min(length, submessage.size - kSubmessage),
                         submessage.little};
      if (sample.size < kSampleHeader || !std::equal(kAnnouncer.begin(), kAnnouncer.end(), sample.at + kWriterAt))
        return std::nullopt;
      inline_qos = (message[at + 1] & kInlineQos) != 0;
      return sample;
    }
    if (length == 0) return std::nullopt;  // the last one
    at += kSubmessage + length;
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::uint64_t> Announcements::sequence_of(const std::uint8_t* message, std::uint32_t size) {
  bool inline_qos = false;
  const std::optional<Bytes> sample = announcement_of(message, size, inline_qos);
  if (!sample) return std::nullopt;
  return std::uint64_t{sample->number(kSequenceAt, 4)} << 32u | sample->number(kSequenceAt + 4, 4);
}

void Announcements::on_received(const std::uint8_t* message, std::uint32_t size) {
  bool inline_qos = false;
  const std::optional<Bytes> sample = announcement_of(message, size, inline_qos);
  if (!sample || inline_qos) return;
  std::array<std::uint8_t, 12> sender;
  std::copy_n(message + kSenderAt, sender.size(), sender.begin());
  const std::lock_guard<std::mutex> lock{mutex_};
  if (met_.size() > kMany) met_.clear();
  if (!met_.insert(sender).second || sample->size < kSampleHeader + kEncapsulation) return;
  const Bytes list{sample->at + kSampleHeader, sample->size - kSampleHeader, (sample->at[kSampleHeader + 1] & 1u) != 0};
  for (std::uint32_t at = kEncapsulation; at + kParameter <= list.size;) {
    const std::uint32_t id = list.number(at, 2), length = list.number(at + 2, 2);
    if (id == kMetatrafficUnicast && length == kLocator && at + kParameter + kLocator <= list.size) {
      const std::uint8_t* const address = list.at + at + kParameter + 8;
      forget(list.number(at + kParameter + 4, 4), address);
    }
    at += kParameter + length;
  }
}

/// Whoever was there before. Participants of this machine are reached through its loopback.
void Announcements::forget(std::uint32_t port, const std::uint8_t* address) {
  for (auto at = sent_.begin(); at != sent_.end();) {
    const Locator& to = at->first.second;
    const bool there = to.port == port && (IPLocator::isLocal(to) || std::equal(to.address, to.address + 16, address));
    at = there ? sent_.erase(at) : std::next(at);
  }
}

std::vector<Announcements::Locator> Announcements::due(const void* sender, std::uint64_t sequence,
                                                       const std::vector<Locator>& to, std::int64_t now_ns) {
  const auto is_group = [](const Locator& locator) { return IPLocator::isMulticast(locator); };
  const bool has_group = std::any_of(to.begin(), to.end(), is_group);
  std::vector<Locator> due;
  const std::lock_guard<std::mutex> lock{mutex_};
  if (sent_.size() > kMany) sent_.clear();
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
