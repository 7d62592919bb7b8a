/// Applies a Discovery to the QoS of a Fast DDS participant. Never included outside wire/.
#pragma once

#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>

#include "wire/participants.hpp"

namespace tactus::wire {

/// Throws WireError for a name that does not resolve to an IPv4 address, an invalid port, or peers together with
/// servers. Resolving a name may take seconds.
void apply(const Discovery& discovery, eprosima::fastdds::dds::DomainParticipantQos& qos);

/// Removes ROS_DISCOVERY_SERVER, which would make every participant a client of the servers that it names.
void ignore_environment();

}  // namespace tactus::wire
