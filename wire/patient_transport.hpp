/// The library's UDP, which takes nothing in until the participant is made: Fast DDS 2.9.1 announces a participant
/// before its receivers take what comes. The others answer within a fraction of a millisecond; it would read the
/// answers and drop them, and, being known to them, hear of them only by their next announcement, up to half a second
/// later. What comes meanwhile waits in the sockets' buffers instead.
#pragma once

#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>

#include "wire/direct.hpp"

namespace tactus::wire {

/// Closed until opened, for ever open then. Threads: any.
class Gate {
 public:
  explicit Gate(std::chrono::milliseconds patience = std::chrono::seconds{1}) : patience_{patience} {}
  void open() noexcept;
  /// Returns when it is open, or its patience over: a participant that fails to be made waits for its receive threads.
  void pass();

 private:
  std::chrono::milliseconds patience_;
  std::mutex mutex_;
  std::condition_variable opened_;
  std::atomic<bool> open_{false};
};

/// Wraps a descriptor of the profiles. The gate is opened by whoever makes the participant, once it is made.
struct PatientTransportDescriptor final : eprosima::fastdds::rtps::ChainingTransportDescriptor {
  PatientTransportDescriptor(std::shared_ptr<eprosima::fastdds::rtps::TransportDescriptorInterface> low,
                             std::shared_ptr<Gate> gate, std::string ignored = {},
                             std::shared_ptr<DirectPath> direct = {});
  [[nodiscard]] eprosima::fastdds::rtps::TransportInterface* create_transport() const override;

  std::shared_ptr<Gate> gate;
  std::shared_ptr<DirectPath> direct;  ///< is offered what comes before the library; null: none
  std::string ignored;                 ///< name of participants that are not met; empty: all are
};

}  // namespace tactus::wire
