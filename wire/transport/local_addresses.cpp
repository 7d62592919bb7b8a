#include "wire/transport/local_addresses.hpp"

#include <ifaddrs.h>
#include <netinet/in.h>

#include <cstring>
#include <optional>
#include <utility>

#include "realtime/process.hpp"

namespace tactus::wire {
namespace {

/// Returns nothing if the system refuses.
std::optional<std::set<std::uint32_t>> read_addresses() {
  std::set<std::uint32_t> addresses;
  ifaddrs* first = nullptr;
  if (::getifaddrs(&first) != 0) return std::nullopt;
  for (const ifaddrs* i = first; i != nullptr; i = i->ifa_next)
    if (i->ifa_addr != nullptr && i->ifa_addr->sa_family == AF_INET)
      addresses.insert(reinterpret_cast<const sockaddr_in*>(i->ifa_addr)->sin_addr.s_addr);
  ::freeifaddrs(first);
  return addresses;
}

}  // namespace

LocalAddresses::LocalAddresses()
    : addresses_{read_addresses().value_or(std::set<std::uint32_t>{})}, read_ns_{realtime::monotonic_ns()} {}

bool LocalAddresses::contains(const rtps::Locator_t& locator, std::int64_t now_ns) {
  constexpr std::size_t kIpv4At = 12;  // an IPv4 address has the last four of 16 bytes
  constexpr std::int64_t kMinIntervalNs = 1'000'000'000, kMaxAgeNs = 5'000'000'000;
  const auto* const bytes = locator.address + kIpv4At;
  if (bytes[0] == IN_LOOPBACKNET) return true;
  std::uint32_t address = 0;
  std::memcpy(&address, bytes, sizeof address);
  const std::lock_guard lock{mutex_};
  const bool is_known = addresses_.count(address) != 0;
  if (now_ns - read_ns_ < (is_known ? kMaxAgeNs : kMinIntervalNs)) return is_known;
  read_ns_ = now_ns;
  if (auto addresses = read_addresses()) addresses_ = *std::move(addresses);
  return addresses_.count(address) != 0;
}

}  // namespace tactus::wire
