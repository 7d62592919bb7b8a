#include "wire/direct.hpp"

#include <fastdds/rtps/reader/ReaderDiscoveryInfo.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>
#include <system_error>

#include "wire/rtps_message.hpp"

namespace tactus::wire {
namespace {

namespace rtps = eprosima::fastrtps::rtps;

constexpr int kSendBuffer = 1 << 20;  // bytes, as qos/probe.xml has it
// RTPS 2.2, 8.3.3 and 9.4: who sends a message; what a sample begins with, from behind its submessage's head.
constexpr std::size_t kPrefix = 12, kSenderAt = 8;
constexpr std::uint32_t kToInlineQosAt = 2, kWriterAt = 8, kSequenceAt = 12, kSampleHead = 20, kUsualToInlineQos = 16;
constexpr std::uint8_t kLittleEndian = 0x01, kInlineQos = 0x02, kHasData = 0x04;
constexpr std::uint8_t kBuiltIn = 0xc0;                                            // of an entity's kind
constexpr std::uint64_t kLastSequence = std::numeric_limits<std::int64_t>::max();  // they are signed, from 1 (8.3.5.4)

sockaddr_in address_of(const rtps::Locator_t& locator) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(locator.port));
  std::memcpy(&address.sin_addr, locator.address + 12, sizeof address.sin_addr);
  return address;
}

bool same(const sockaddr_in& a, const sockaddr_in& b) {
  return a.sin_port == b.sin_port && a.sin_addr.s_addr == b.sin_addr.s_addr;
}

void put(std::uint8_t* at, std::uint32_t value, int bytes) {
  for (int i = 0; i < bytes; ++i) at[i] = static_cast<std::uint8_t>(value >> 8 * i);
}

std::uint32_t number(const std::uint8_t* at, int bytes, bool little) {
  std::uint32_t value = 0;
  for (int i = 0; i < bytes; ++i) value = value << 8u | at[little ? bytes - 1 - i : i];
  return value;
}

bool is_for(const Submessage& destination, const rtps::GuidPrefix_t& own) {
  if (destination.size < kPrefix) return false;
  const auto is_zero = [](std::uint8_t byte) { return byte == 0; };
  return std::equal(own.value, own.value + kPrefix, destination.body) ||
         std::all_of(destination.body, destination.body + kPrefix, is_zero);
}

}  // namespace

std::optional<EncodedSample> sole_sample(const std::uint8_t* message, std::uint32_t size,
                                         const rtps::GuidPrefix_t& own) {
  constexpr std::array<std::uint8_t, 4> kMagic{'R', 'T', 'P', 'S'};
  if (size < kRtpsHeader || !std::equal(kMagic.begin(), kMagic.end(), message)) return std::nullopt;
  std::optional<EncodedSample> sample;
  std::uint32_t at = kRtpsHeader;
  while (const std::optional<Submessage> found = submessage_at(message, size, at)) {
    if (found->id == kInfoDestinationId) {
      if (!is_for(*found, own)) return std::nullopt;
    } else if (found->id == kDataId) {
      const std::uint8_t* const body = found->body;
      if (sample || (found->flags & (kInlineQos | kHasData)) != kHasData || found->size <= kSampleHead ||
          (body[kWriterAt + 3] & kBuiltIn) != 0 ||
          number(body + kToInlineQosAt, 2, found->little_endian()) != kUsualToInlineQos)
        return std::nullopt;
      sample.emplace();
      std::copy_n(message + kSenderAt, kPrefix, sample->writer.guidPrefix.value);
      std::copy_n(body + kWriterAt, 4, sample->writer.entityId.value);
      sample->sequence = std::uint64_t{number(body + kSequenceAt, 4, found->little_endian())} << 32u |
                         number(body + kSequenceAt + 4, 4, found->little_endian());
      if (sample->sequence == 0 || sample->sequence > kLastSequence) return std::nullopt;
      sample->bytes = body + kSampleHead;
      sample->size = found->size - kSampleHead;
    } else if (found->id != kInfoTimeId && found->id != kPadId && found->id != kStatisticsId) {
      return std::nullopt;
    }
    if (found->last) break;
    at = found->next;
  }
  return sample;
}

void DirectTaker::close() {
  const std::lock_guard lock{mutex_};
  take_ = nullptr;
}

void DirectTaker::take(const EncodedSample& sample, std::uint64_t& newest) {
  const std::lock_guard lock{mutex_};  // unicast and multicast have a thread each
  if (!take_ || sample.sequence <= newest) return;
  if (newest != 0) lost_ += sample.sequence - newest - 1;
  newest = sample.sequence;
  take_(sample.bytes, sample.size);
}

std::uint64_t DirectTaker::lost() const {
  const std::lock_guard lock{mutex_};
  return lost_;
}

DirectPath::DirectPath() : socket_{::socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0)} {
  if (socket_ < 0) throw std::system_error{errno, std::generic_category(), "a datagram socket"};
  setsockopt(socket_, SOL_SOCKET, SO_SNDBUF, &kSendBuffer, sizeof kSendBuffer);
}
DirectPath::~DirectPath() { ::close(socket_); }

std::vector<sockaddr_in> DirectPath::places_of(const Guid& reader) const {
  const std::lock_guard lock{mutex_};
  const auto found = places_.find(reader);
  return found == places_.end() ? std::vector<sockaddr_in>{} : found->second;
}

void DirectPath::on_subscriber_discovery(eprosima::fastdds::dds::DomainParticipant*,
                                         rtps::ReaderDiscoveryInfo&& found) {
  const std::lock_guard lock{mutex_};
  if (found.status == rtps::ReaderDiscoveryInfo::REMOVED_READER) {
    places_.erase(found.info.guid());
    ++changes_;
    return;
  }
  std::vector<sockaddr_in>& places = places_[found.info.guid()];
  places.clear();
  const auto add = [&](const auto& locators) {
    for (const rtps::Locator_t& locator : locators)
      if (locator.kind == LOCATOR_KIND_UDPv4) places.push_back(address_of(locator));
  };
  add(found.info.remote_locators().unicast);
  if (places.empty()) add(found.info.remote_locators().multicast);
  ++changes_;
}

void DirectPath::set_own(const rtps::GuidPrefix_t& own) {
  const std::lock_guard lock{mutex_};
  own_ = own;
}

void DirectPath::on_writer(const Guid& writer, const std::shared_ptr<DirectTaker>& taker) {
  const std::lock_guard lock{mutex_};
  std::vector<Route>& routes = routes_[writer];
  if (std::none_of(routes.begin(), routes.end(), [&](const Route& route) { return route.taker == taker; }))
    routes.push_back({taker, std::make_shared<std::uint64_t>(0)});
}

void DirectPath::on_writer_lost(const Guid& writer, const std::shared_ptr<DirectTaker>& taker) {
  const std::lock_guard lock{mutex_};
  const auto found = routes_.find(writer);
  if (found == routes_.end()) return;
  std::vector<Route>& routes = found->second;
  routes.erase(std::remove_if(routes.begin(), routes.end(), [&](const Route& route) { return route.taker == taker; }),
               routes.end());
  if (routes.empty()) routes_.erase(found);
}

void DirectPath::forget(const std::shared_ptr<DirectTaker>& taker) {
  std::vector<Guid> writers;
  {
    const std::lock_guard lock{mutex_};
    for (const auto& [writer, routes] : routes_) writers.push_back(writer);
  }
  for (const Guid& writer : writers) on_writer_lost(writer, taker);
}

bool DirectPath::on_received(const std::uint8_t* message, std::uint32_t size) {
  std::optional<EncodedSample> sample;
  std::array<Route, 4> routes;  // with the lock let go: a callback may wait for those of the library
  std::size_t count = 0;
  {
    const std::lock_guard lock{mutex_};
    sample = sole_sample(message, size, own_);
    if (!sample) return false;
    const auto found = routes_.find(sample->writer);
    if (found == routes_.end() || found->second.size() > routes.size()) return false;
    for (const Route& route : found->second) routes[count++] = route;
  }
  for (std::size_t i = 0; i < count; ++i) routes[i].taker->take(*sample, *routes[i].newest);
  return true;
}

DirectWriter::DirectWriter(const DirectPath& path, const Guid& writer) : path_{path} {
  std::uint8_t* at = message_.data();
  constexpr std::array<std::uint8_t, kSenderAt> kStart{'R', 'T', 'P', 'S', 2, 2, 1, 15};  // version, vendor
  std::copy(kStart.begin(), kStart.end(), at);
  std::copy_n(writer.guidPrefix.value, kPrefix, at + kSenderAt);
  at += kRtpsHeader;
  at[0] = kDataId;
  at[1] = kLittleEndian | kHasData;
  at += kSubmessageHead;
  at[kToInlineQosAt] = kUsualToInlineQos;
  std::copy_n(writer.entityId.value, 4, at + kWriterAt);  // to any reader: 0 before it
}

void DirectWriter::on_reader(const Guid& reader) {
  const std::lock_guard lock{mutex_};
  readers_.insert(reader);
  collect_places();
}

void DirectWriter::on_reader_lost(const Guid& reader) {
  const std::lock_guard lock{mutex_};
  readers_.erase(reader);
  collect_places();
}

void DirectWriter::collect_places() {
  changes_ = path_.changes();
  places_.clear();
  for (const Guid& reader : readers_)
    for (const sockaddr_in& place : path_.places_of(reader))
      if (std::none_of(places_.begin(), places_.end(), [&](const auto& other) { return same(other, place); }))
        places_.push_back(place);
}

bool DirectWriter::send(std::size_t size) noexcept {
  std::uint8_t* const sample = message_.data() + kRtpsHeader;
  ++sequence_;
  for (; size % 4 != 0; ++size) body()[size] = 0;
  put(sample + 2, static_cast<std::uint32_t>(kSampleHead + size), 2);
  put(sample + kSubmessageHead + kSequenceAt, static_cast<std::uint32_t>(sequence_ >> 32u), 4);
  put(sample + kSubmessageHead + kSequenceAt + 4, static_cast<std::uint32_t>(sequence_), 4);
  const std::lock_guard lock{mutex_};
  if (changes_ != path_.changes()) collect_places();
  bool any = places_.empty();
  iovec bytes{message_.data(),
              pad_what_looks_like_statistics(message_.data(), static_cast<std::uint32_t>(kHead + size))};
  constexpr std::size_t kAtOnce = 32;
  std::array<mmsghdr, kAtOnce> messages;
  for (std::size_t from = 0; from < places_.size(); from += kAtOnce) {
    const std::size_t count = std::min(kAtOnce, places_.size() - from);
    for (std::size_t i = 0; i < count; ++i) {
      messages[i] = {};
      messages[i].msg_hdr.msg_name = &places_[from + i];
      messages[i].msg_hdr.msg_namelen = sizeof(sockaddr_in);
      messages[i].msg_hdr.msg_iov = &bytes;
      messages[i].msg_hdr.msg_iovlen = 1;
    }
    for (std::size_t done = 0; done < count;) {  // one that is refused ends a call: those behind it get theirs
      const int sent = ::sendmmsg(path_.socket(), messages.data() + done, static_cast<unsigned>(count - done), 0);
      any |= sent > 0;
      done += static_cast<std::size_t>(std::max(sent, 1));
    }
  }
  return any;
}

}  // namespace tactus::wire
