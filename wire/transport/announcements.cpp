#include "wire/transport/announcements.hpp"

#include <algorithm>
#include <array>
#include <iterator>

namespace tactus::wire {
namespace {

using rtps::IPLocator;

constexpr std::uint32_t kMetatrafficUnicast = 0x32, kName = 0x62;  // parameters (RTPS 2.2, 9.6.2)
constexpr std::uint32_t kLocatorSize = 24, kPortAt = 4, kAddressAt = 8;
constexpr std::size_t kMaxEntries = 4096;

/// True if a CDR string equals `text`. A CDR string has a length, which includes the zero byte at the end, and bytes.
bool is_text(const RtpsBytes& value, const std::string& text) {
  const auto bytes = static_cast<std::uint32_t>(text.size());
  return value.size > 4 + bytes && value.number(0, 4) == bytes + 1 &&
         std::equal(text.begin(), text.end(), value.at + 4);
}

}  // namespace

std::optional<std::uint64_t> Announcements::sequence_of(const std::uint8_t* message, std::uint32_t size) {
  const std::optional<Announcement> announcement = announcement_in(message, size);
  return announcement ? std::optional{announcement->data.sequence} : std::nullopt;
}

bool Announcements::on_received(const std::uint8_t* message, std::uint32_t size) {
  const std::optional<Announcement> announcement = announcement_in(message, size);
  if (!announcement || announcement->data.payload.size == 0) return true;
  const std::lock_guard<std::mutex> lock{mutex_};
  if (discovered_.size() > kMaxEntries) discovered_.clear();
  const auto [entry, is_new] = discovered_.try_emplace(sender_of(message), true);
  if (!is_new) return entry->second;
  ParameterList parameters = parameters_of(announcement->data.payload);
  while (const auto parameter = parameters.next()) {
    const RtpsBytes& value = parameter->value;
    if (parameter->id == kMetatrafficUnicast && value.size == kLocatorSize)
      forget(value.number(kPortAt, 4), value.at + kAddressAt);
    if (parameter->id == kName && !ignored_name_.empty() && is_text(value, ignored_name_)) entry->second = false;
  }
  return entry->second;
}

/// Forgets the announcements that were sent to this locator, or to the loopback address of this machine at its port.
void Announcements::forget(std::uint32_t port, const std::uint8_t* address) {
  for (auto at = sent_.begin(); at != sent_.end();) {
    const Locator& to = at->first.second;
    const bool is_same =
        to.port == port && (IPLocator::isLocal(to) || std::equal(to.address, to.address + 16, address));
    at = is_same ? sent_.erase(at) : std::next(at);
  }
}

std::vector<Announcements::Locator> Announcements::due(const void* sender, std::uint64_t sequence,
                                                       const std::vector<Locator>& to, std::int64_t now_ns) {
  const auto is_group = [](const Locator& locator) { return IPLocator::isMulticast(locator); };
  std::vector<Locator> due;
  const std::lock_guard<std::mutex> lock{mutex_};
  if (std::any_of(to.begin(), to.end(), is_group)) group_ns_ = now_ns;
  const bool has_group = group_ns_ && now_ns - *group_ns_ < kUnicastIntervalNs;
  if (sent_.size() > kMaxEntries) sent_.clear();
  for (const Locator& locator : to) {
    const std::int64_t interval_ns = has_group && !is_group(locator) ? kUnicastIntervalNs : kGroupIntervalNs;
    const auto [at, first] = sent_.try_emplace({sender, locator}, Sent{sequence, now_ns});
    if (!first && at->second.sequence == sequence && now_ns - at->second.time_ns < interval_ns) continue;
    at->second = {sequence, now_ns};
    due.push_back(locator);
  }
  return due;
}

}  // namespace tactus::wire
