#include "wire/announcements.hpp"

#include <fastrtps/utils/IPLocator.h>

#include <algorithm>
#include <array>
#include <iterator>

#include "wire/rtps_message.hpp"

namespace tactus::wire {
namespace {

using eprosima::fastrtps::rtps::IPLocator;

// RTPS 2.2, 8.3.3 and 9.4: who sends a message; what a sample begins with, then its encapsulation and parameters.
constexpr std::uint32_t kSenderAt = 8, kWriterAt = 8, kSequenceAt = 12;
constexpr std::uint32_t kSampleHeader = 20, kEncapsulation = 4, kParameter = 4, kLocator = 24;
constexpr std::uint8_t kInlineQos = 0x02, kHasData = 0x04;
constexpr std::uint32_t kSentinel = 0x01, kMetatrafficUnicast = 0x32, kName = 0x62;  // parameters (9.6.2)
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

/// The sample of a message that announces a participant, and its flags.
std::optional<Bytes> announcement_of(const std::uint8_t* message, std::uint32_t size, std::uint8_t& flags) {
  std::uint32_t at = kRtpsHeader;
  while (const std::optional<Submessage> found = submessage_at(message, size, at)) {
    if (found->id == kDataId) {
      if (found->size < kSampleHeader || !std::equal(kAnnouncer.begin(), kAnnouncer.end(), found->body + kWriterAt))
        return std::nullopt;
      flags = found->flags;
      return Bytes{found->body, found->size, found->little_endian()};
    }
    if (found->last) return std::nullopt;
    at = found->next;
  }
  return std::nullopt;
}

/// Where what is said of the participant begins in a sample: behind what the library says of the sample itself.
std::uint32_t said_at(const Bytes& sample, std::uint8_t flags) {
  std::uint32_t at = kSampleHeader;
  if ((flags & kInlineQos) == 0) return at;
  while (at + kParameter <= sample.size) {
    const bool last = sample.number(at, 2) == kSentinel;
    at += kParameter + (last ? 0 : sample.number(at + 2, 2));
    if (last) break;
  }
  return at;
}

}  // namespace

std::optional<std::uint64_t> Announcements::sequence_of(const std::uint8_t* message, std::uint32_t size) {
  std::uint8_t flags = 0;
  const std::optional<Bytes> sample = announcement_of(message, size, flags);
  if (!sample) return std::nullopt;
  return std::uint64_t{sample->number(kSequenceAt, 4)} << 32u | sample->number(kSequenceAt + 4, 4);
}

bool Announcements::on_received(const std::uint8_t* message, std::uint32_t size) {
  std::uint8_t flags = 0;
  const std::optional<Bytes> sample = announcement_of(message, size, flags);
  if (!sample || (flags & kHasData) == 0) return true;
  std::array<std::uint8_t, 12> sender;
  std::copy_n(message + kSenderAt, sender.size(), sender.begin());
  const std::lock_guard<std::mutex> lock{mutex_};
  if (met_.size() > kMany) met_.clear();
  const auto [met, is_new] = met_.try_emplace(sender, true);
  const std::uint32_t said = said_at(*sample, flags);
  if (!is_new || sample->size < said + kEncapsulation) return met->second;
  const Bytes list{sample->at + said, sample->size - said, (sample->at[said + 1] & 1u) != 0};
  for (std::uint32_t at = kEncapsulation; at + kParameter <= list.size;) {
    const std::uint32_t id = list.number(at, 2), length = list.number(at + 2, 2);
    if (id == kMetatrafficUnicast && length == kLocator && at + kParameter + kLocator <= list.size) {
      const std::uint8_t* const address = list.at + at + kParameter + 8;
      forget(list.number(at + kParameter + 4, 4), address);
    }
    // A text is its length, the zero at its end included, and its bytes.
    const std::uint32_t text = at + kParameter + 4, bytes = static_cast<std::uint32_t>(ignored_name_.size());
    if (id == kName && bytes != 0 && length > 4 + bytes && text + bytes < list.size &&
        list.number(text - 4, 4) == bytes + 1 && std::equal(ignored_name_.begin(), ignored_name_.end(), list.at + text))
      met->second = false;
    at += kParameter + length;
  }
  return met->second;
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
  std::vector<Locator> due;
  const std::lock_guard<std::mutex> lock{mutex_};
  if (std::any_of(to.begin(), to.end(), is_group)) group_ns_ = now_ns;
  const bool has_group = group_ns_ && now_ns - *group_ns_ < kKnownRestNs;
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
