/// Turns a Discovery into what Fast DDS knows. Never included outside wire/.
#pragma once

#include <fastdds/dds/domain/qos/DomainParticipantQos.hpp>

#include "wire/participants.hpp"

namespace tactus::wire {

/// Throws WireError for a name that does not resolve to an IPv4 address, a port that is none, or peers and servers at
/// once. Resolving a name may take seconds.
void apply(const Discovery& discovery, eprosima::fastdds::dds::DomainParticipantQos& qos);

/// The library turns every participant into a client of the servers that ROS_DISCOVERY_SERVER names: forgets that.
void ignore_environment();

}  // namespace tactus::wire
