#include "wire/discovery.hpp"

#include <arpa/inet.h>
#include <netdb.h>

#include <charconv>
#include <cstdlib>
#include <memory>

#include "wire/transport/local_addresses.hpp"

namespace tactus::wire {
namespace {

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

}  // namespace

void apply(const Discovery& discovery, dds::DomainParticipantQos& qos) {
  if (!discovery.peers.empty() && !discovery.servers.empty()) {
    throw WireError("found both peers and a discovery server; expected one of the two");
  }
  auto& builtin = qos.wire_protocol().builtin;
  for (const std::string& peer : discovery.peers) {
    builtin.initialPeersList.push_back(locator(peer, 0));  // port 0: all discovery ports in the profile's range
  }
  if (!discovery.peers.empty()) builtin.initialPeersList.push_back(locator("127.0.0.1", 0));

  int number = 0;
  for (const std::string& server : discovery.servers) {
    if (!add_discovery_server(qos, server_locator(server), number++))
      throw WireError(std::to_string(discovery.servers.size()) + " discovery servers; expected at most 256");
  }
}

void require_local(const Discovery& discovery) {
  LocalAddresses local;
  const auto require = [&](const std::string& name, const rtps::Locator_t& at) {
    if (!local.contains(at))
      throw WireError("'" + name + "' is another machine, and this program has no keys; expected --keys DIR " +
                      "(docs/how-to/secure.md), or --plain for a session that everyone can read and change");
  };
  for (const std::string& peer : discovery.peers) require(peer, locator(peer, 0));
  for (const std::string& server : discovery.servers) require(server, server_locator(server));
}

void ignore_environment() {
  for (const char* name : kIgnoredVariables) unsetenv(name);
  setenv("SKIP_DEFAULT_XML_FILE", "1", 1);
}

}  // namespace tactus::wire
