/// The UDP transport of Fast DDS with message filters. It delays, drops or shortens messages and creates none.
///
///     out   announcements: only to receivers without a recent repetition          (announcements.hpp)
///           samples:       without the submessages that no reader uses            (trimming.hpp)
///     in    everything:    after the participant has been created                 (gate.hpp)
///           announcements: without those of ignored participants                  (announcements.hpp)
///           everything:    without statistics                                     (rtps_message.hpp)
///
/// The gate: Fast DDS 2.9.1 announces a participant before it can receive. Other participants answer within a fraction
/// of a millisecond. The library would drop these answers and discover the others only by their next periodic
/// announcement, up to half a second later. With the gate, early messages wait in the socket buffers.
/// Figure: decision 11, late joiners that receive their first probe state within 50 ms (`scripts/bench rejoin`): 98 of
/// 100, without the gate 81 of 100.
#pragma once

#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>

#include <memory>
#include <string>

#include "wire/transport/gate.hpp"

namespace tactus::wire {

struct FilterSettings {
  std::shared_ptr<Gate> gate;  ///< opened by the caller after the participant has been created
  std::string ignored;         ///< name of participants that are ignored; empty: none
  bool trims_samples = false;
};

/// Wraps a transport descriptor of the profiles; its maxMessageSize stays the size of the largest datagram.
struct FilterTransportDescriptor final : eprosima::fastdds::rtps::ChainingTransportDescriptor {
  FilterTransportDescriptor(std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> udp,
                            FilterSettings settings);
  [[nodiscard]] std::uint32_t max_message_size() const override { return maxMessageSize; }
  [[nodiscard]] eprosima::fastdds::rtps::TransportInterface* create_transport() const override;

  FilterSettings settings;
};

}  // namespace tactus::wire
