/// The library's UDP for samples of one reader, or of several that each get a datagram, without what nobody reads:
/// Debian's build of Fast DDS ends every RTPS message with a submessage of its vendor's statistics, 60 bytes; and each
/// sample is preceded by its destination and its time, 28 bytes, which its one receiver assumes or does not ask for.
/// What goes out is standard RTPS as before.
#pragma once

#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>

#include <cstdint>
#include <memory>

namespace tactus::wire {

/// Wraps a descriptor of the profiles, whose maxMessageSize then is what goes into a datagram.
struct LeanTransportDescriptor final : eprosima::fastdds::rtps::ChainingTransportDescriptor {
  explicit LeanTransportDescriptor(std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> low);
  [[nodiscard]] std::uint32_t max_message_size() const override { return maxMessageSize; }
  [[nodiscard]] eprosima::fastdds::rtps::TransportInterface* create_transport() const override;
};

}  // namespace tactus::wire
