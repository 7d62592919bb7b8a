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

/// Removes the environment variables by which Fast DDS would use discovery servers or a profile file that Tactus does
/// not know, and keeps it from reading a profile file of the current directory.
void ignore_environment();

}  // namespace tactus::wire
