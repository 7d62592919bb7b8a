#include "wire/discovery.hpp"

#include <arpa/inet.h>
#include <netdb.h>

#include <charconv>
#include <chrono>
#include <cstdlib>
#include <future>
#include <memory>
#include <thread>
#include <utility>

#include "realtime/process.hpp"
#include "wire/dds.hpp"
#include "wire/transport/local_addresses.hpp"

namespace tactus::wire {
namespace {

/// The locator of `host`. Port 0 in the locator of a peer: all discovery ports in the profile's range.
rtps::Locator_t locator(const std::string& host, std::uint32_t port) {
  addrinfo hints{};
  hints.ai_family = AF_INET;  // all transports of qos/ are UDPv4
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  if (const int error = getaddrinfo(host.c_str(), nullptr, &hints, &found); error != 0) {
    throw WireError("'" + host + "' does not resolve to an IPv4 address: " + gai_strerror(error));
  }
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owner{found, freeaddrinfo};
  char text[INET_ADDRSTRLEN]{};
  inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(found->ai_addr)->sin_addr, text, sizeof text);
  rtps::Locator_t made;
  rtps::IPLocator::createLocator(LOCATOR_KIND_UDPv4, text, port, made);
  return made;
}

/// The locator of `server`, which is HOST or HOST:PORT.
rtps::Locator_t server_locator(const std::string& server) {
  const std::size_t colon = server.rfind(':');
  if (colon == std::string::npos) return locator(server, kDiscoveryServerPort);
  const std::string digits = server.substr(colon + 1);
  std::uint16_t port = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), port);
  if (error != std::errc{} || end != digits.data() + digits.size() || port == 0) {
    throw WireError("discovery server '" + server + "' has port '" + digits + "'; expected 1 to 65535");
  }
  return locator(server.substr(0, colon), port);
}

/// Time to resolve the names of peers of which some may be left out.
constexpr std::chrono::seconds kMaxResolving{2};

/// Resolves a name in a thread of its own, because the resolver has no limit of time.
std::future<rtps::Locator_t> start_resolving(const std::string& host) {
  std::packaged_task<rtps::Locator_t()> task{[host] { return locator(host, 0); }};
  std::future<rtps::Locator_t> found = task.get_future();
  in_addr address{};
  if (inet_pton(AF_INET, host.c_str(), &address) == 1)
    task();
  else
    std::thread{std::move(task)}.detach();
  return found;
}

/// Returns the peers whose names resolve in time, and reports the others. Throws WireError if none resolves.
std::vector<NamedLocator> resolve_some(const std::vector<std::string>& names) {
  std::vector<std::future<rtps::Locator_t>> pending;
  for (const std::string& name : names) pending.push_back(start_resolving(name));
  const auto end = std::chrono::steady_clock::now() + kMaxResolving;
  std::vector<NamedLocator> found;
  std::vector<std::string> reasons;
  for (std::size_t i = 0; i < names.size(); ++i) {
    try {
      if (pending[i].wait_until(end) != std::future_status::ready)
        throw WireError("'" + names[i] + "' does not resolve to an IPv4 address within " +
                        std::to_string(kMaxResolving.count()) + " s");
      found.push_back({names[i], pending[i].get()});
    } catch (const WireError& error) {
      reasons.emplace_back(error.what());
    }
  }
  if (found.empty() && !reasons.empty()) throw WireError(reasons.front());
  for (const std::string& reason : reasons) report(reason + "; this program continues without this peer");
  return found;
}

}  // namespace

DiscoveryLocators resolve(const Discovery& discovery) {
  if (!discovery.peers.empty() && !discovery.servers.empty()) {
    throw WireError("found both peers and a discovery server; expected one of the two");
  }
  DiscoveryLocators found;
  for (const std::string& server : discovery.servers) found.servers.push_back({server, server_locator(server)});
  if (discovery.skips_unknown_peers)
    found.peers = resolve_some(discovery.peers);
  else
    for (const std::string& peer : discovery.peers) found.peers.push_back({peer, locator(peer, 0)});
  return found;
}

void apply(const DiscoveryLocators& discovery, dds::DomainParticipantQos& qos) {
  auto& builtin = qos.wire_protocol().builtin;
  for (const NamedLocator& peer : discovery.peers) builtin.initialPeersList.push_back(peer.at);
  if (!discovery.peers.empty()) builtin.initialPeersList.push_back(locator("127.0.0.1", 0));

  int number = 0;
  for (const NamedLocator& server : discovery.servers) {
    if (!add_discovery_server(qos, server.at, number++))
      throw WireError(std::to_string(discovery.servers.size()) + " discovery servers; expected at most 256");
  }
}

void require_local(const DiscoveryLocators& discovery) {
  LocalAddresses local;
  for (const std::vector<NamedLocator>& named : {discovery.peers, discovery.servers})
    for (const NamedLocator& other : named)
      if (!local.contains(other.at, realtime::monotonic_ns()))
        throw WireError("'" + other.name + "' is another machine, and this program has no keys; expected --keys DIR " +
                        "(docs/how-to/secure.md), or --plain for a session that everyone can read and change");
}

void ignore_environment() {
  for (const char* name : kIgnoredVariables) unsetenv(name);
  setenv("SKIP_DEFAULT_XML_FILE", "1", 1);
}

}  // namespace tactus::wire
