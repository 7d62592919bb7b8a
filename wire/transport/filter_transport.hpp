/// Adds filters to the UDP transport of Fast DDS. They delay, drop, shorten or complete messages, and create none.
///
///     sent      announcements: dropped if the receiver got the same one recently    (announcements.hpp)
///               announcements: with keys, completed with the removed participants   (removals.hpp)
///               samples:       sent without the submessages that no reader uses     (trimming.hpp)
///     received  all messages:  delayed until the participant has been created       (gate.hpp)
///               all messages:  without keys, dropped if they are of another machine, unless it is wanted
///               all messages:  with keys, dropped if they are not protected         (protection.hpp)
///               all messages:  with keys, dropped if their sender is no member, or has removed this participant
///                                                                                   (members.hpp)
///               announcements: dropped if their participant is ignored              (announcements.hpp)
///               announcements, handshakes: with keys, passed on one at a time
///               all messages:  passed on without statistics                         (rtps_message.hpp)
///
/// Reason for the gate: Fast DDS 2.9.1 announces a participant before the participant can receive. Other participants
/// answer within a fraction of a millisecond. The library would drop these answers and discover the others only by
/// their next periodic announcement, up to half a second later. With the gate, early messages wait in the socket
/// buffers. Figure of decision 11 (`scripts/bench rejoin`): of 100 participants that join a session, 98 receive their
/// first probe state within 50 ms; before that decision, 81.
///
/// The filters also choose the ports at which a participant begins to search for free ones: those of the first program
/// of the machine (footprint.hpp). Fast DDS begins at the number of the participant in the process, and uses no number
/// again. After 120 participants the ports of one domain would reach those of the next.
///
/// Reason for one at a time: Fast DDS 2.9.1 prepares handshakes in variables that its receive threads share without a
/// lock. If two threads do so at once, one of the handshakes never starts, or the program crashes (decision 51).
#pragma once

#include <atomic>
#include <memory>
#include <string>

#include "wire/library.hpp"
#include "wire/transport/gate.hpp"

namespace tactus::wire {

class Security;

struct FilterSettings {
  int domain = 0;              ///< DDS domain of the participant
  std::shared_ptr<Gate> gate;  ///< opened by the caller after the participant has been created
  std::string ignored;         ///< name of the participants to ignore; empty: none
  std::shared_ptr<std::atomic<bool>> multicast_is_taken;  ///< set if the port of multicast discovery cannot be opened
  bool trims_samples = false;                             ///< true: samples are trimmed (trimming.hpp)
  bool only_local = false;                                ///< true: messages of other machines are dropped
  Security* security = nullptr;  ///< with keys: decides which received messages count; must outlive the transport
};

/// Wraps a UDP transport descriptor of the profiles. The maxMessageSize of the profiles is the size of the largest
/// datagram; with trims_samples, that of the wrapper is larger by kMaxTrimmed.
struct FilterTransportDescriptor final : transport::ChainingTransportDescriptor {
  FilterTransportDescriptor(std::shared_ptr<transport::TransportDescriptorInterface> udp, FilterSettings settings);
  [[nodiscard]] std::uint32_t max_message_size() const override { return maxMessageSize; }
  [[nodiscard]] transport::TransportInterface* create_transport() const override;

  FilterSettings settings;
};

}  // namespace tactus::wire
