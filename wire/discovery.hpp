/// Applies a Discovery to the QoS of a Fast DDS participant. Only wire/ includes this header.
#pragma once

#include "wire/library.hpp"
#include "wire/participants.hpp"

namespace tactus::wire {

/// Applies `discovery` to `qos`. Throws WireError for a name that does not resolve to an IPv4 address, for an invalid
/// port, and for peers together with servers. Resolving a name may take seconds.
void apply(const Discovery& discovery, dds::DomainParticipantQos& qos);

/// Throws WireError if a peer or a server is another machine.
void require_local(const Discovery& discovery);

/// Removes kIgnoredVariables from the environment, and keeps Fast DDS from reading a profile file of the current
/// directory. Call it before the first call of the library, which stores FASTDDS_ENVIRONMENT_FILE.
void ignore_environment();

}  // namespace tactus::wire
