/// The UDP transport of Fast DDS with filters in front of it. It delays, drops or shortens messages and makes none.
///
///     out   announcements: to those receivers to which the announcement is news   (announcements.hpp)
///           samples:       without the submessages that nobody reads              (trimming.hpp)
///     in    everything:    after the participant exists                           (gate.hpp)
///           announcements: only of participants that are to be met                (announcements.hpp)
///           everything:    without statistics                                     (rtps_message.hpp)
///
/// The gate: Fast DDS 2.9.1 announces a participant before its receivers are registered. Other participants answer
/// within a fraction of a millisecond. The library would drop these answers, and hear of the others again only with
/// their next periodic announcement, up to half a second later. So what arrives early waits in the sockets' buffers.
/// Figure: decision 11, late joiners that receive their first probe state within 50 ms (`scripts/bench rejoin`):
/// 98 of 100, without the gate 81 of 100.
#pragma once

#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>

#include <memory>
#include <string>

#include "wire/transport/gate.hpp"

namespace tactus::wire {

struct FilterSettings {
  std::shared_ptr<Gate> gate;  ///< who makes the participant opens it afterwards
  std::string ignored;         ///< name of participants that are not met; empty: all are met
  bool trims_samples = false;
};

/// Wraps a descriptor of the profiles, whose maxMessageSize stays the size of the largest datagram.
struct FilterTransportDescriptor final : eprosima::fastdds::rtps::ChainingTransportDescriptor {
  FilterTransportDescriptor(std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> udp,
                            FilterSettings settings);
  [[nodiscard]] std::uint32_t max_message_size() const override { return maxMessageSize; }
  [[nodiscard]] eprosima::fastdds::rtps::TransportInterface* create_transport() const override;

  FilterSettings settings;
};

}  // namespace tactus::wire
