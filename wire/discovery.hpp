/// Resolves a Discovery and applies it to the QoS of a Fast DDS participant. Only wire/ includes this header.
#pragma once

#include <string>
#include <vector>

#include "wire/library.hpp"
#include "wire/participants.hpp"

namespace tactus::wire {

/// The locator of a peer or a server, and its name as the user has written it.
struct NamedLocator {
  std::string name;
  rtps::Locator_t at;
};
struct DiscoveryLocators {
  std::vector<NamedLocator> peers, servers;
};

/// Throws WireError for a name that does not resolve to an IPv4 address, for an invalid port, and for peers together
/// with servers. Resolving a name may take seconds.
[[nodiscard]] DiscoveryLocators resolve(const Discovery& discovery);

/// Throws WireError for too many servers.
void apply(const DiscoveryLocators& discovery, dds::DomainParticipantQos& qos);

/// Throws WireError if a peer or a server is another machine.
void require_local(const DiscoveryLocators& discovery);

/// Removes kIgnoredVariables from the environment, and keeps Fast DDS from reading a profile file of the current
/// directory. Call it before the first call of the library, which stores FASTDDS_ENVIRONMENT_FILE.
void ignore_environment();

}  // namespace tactus::wire
