/// Applies a Discovery to the QoS of a Fast DDS participant. Only wire/ includes this header.
#pragma once

#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>

#include "wire/participants.hpp"

namespace tactus::wire {

/// Applies `discovery` to `qos`. Throws WireError for a name that does not resolve to an IPv4 address, for an invalid
/// port, and for peers together with servers. Resolving a name may take seconds.
void apply(const Discovery& discovery, eprosima::fastdds::dds::DomainParticipantQos& qos);

/// Removes the environment variable ROS_DISCOVERY_SERVER, which would make every participant a client of the discovery
/// servers that it names.
void ignore_environment();

}  // namespace tactus::wire
