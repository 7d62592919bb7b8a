/// How pings and their echoes get from one side to the other: raw UDP, or a topic of Tactus as wire/ makes it.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "latency/cell.hpp"
#include "wire/participants.hpp"

namespace tactus::latency {

/// A ping, or its echo. Times are of the sender's monotonic clock.
struct Packet {
  std::uint32_t sequence = 0;
  std::uint32_t reader = 0;   ///< of an echo: who sends it
  std::int64_t event_ns = 0;  ///< of a ping: when it was to be sent; of an echo: when the ping arrived
  std::int64_t sent_ns = 0;   ///< when it was handed over to be sent
};
/// In a thread of the carrier, one call at a time; may send on the same carrier. `arrived_ns`: our monotonic clock.
using OnPacket = std::function<void(const Packet&, std::int64_t arrived_ns)>;

enum class Part { kPinger, kEchoer };

/// One end. Destroying it ends its thread; no callback runs after that.
class Carrier {
 public:
  virtual ~Carrier() = default;
  /// False when it was refused. The pinger's goes to every echoer. One thread at a time.
  virtual bool send(const Packet& packet) noexcept = 0;
  /// Echoers, or pingers, that this end has found.
  [[nodiscard]] virtual std::uint32_t matched() const noexcept = 0;
};

/// Where a Carrier over UDP is and to whom it sends.
struct UdpPlace {
  std::string echo_address;               ///< pinger only: IPv4 address or name of the echoers' machine
  std::vector<std::uint16_t> echo_ports;  ///< pinger only
  int priority = 0;                       ///< SCHED_FIFO of the receiving thread, 0: none
};
/// Throws LatencyError naming what the system refuses.
[[nodiscard]] std::unique_ptr<Carrier> make_udp(Part part, std::uint32_t payload, const UdpPlace& place,
                                                OnPacket callback);
/// The port that an echoer made by make_udp listens at.
[[nodiscard]] std::uint16_t port_of(const Carrier& udp);

/// Probe states by Cyclone DDS, from the same IDL, with its own defaults otherwise. Threads get SCHED_FIFO `priority`
/// where allowed. Throws LatencyError; only where has_cyclone().
[[nodiscard]] std::unique_ptr<Carrier> make_cyclone(Part part, int domain, int priority, OnPacket callback);

/// On the topic of `cell`, with that topic's own profiles; `links` must outlive it. Pings and echoes have a partition
/// each. Throws WireError.
[[nodiscard]] std::unique_ptr<Carrier> make_dds(Part part, const Cell& cell, wire::Participants& links,
                                                OnPacket callback);

/// Joins as any program of Tactus does, with the transport and profile of `cell`: with `tactus` and `udp`, the qos
/// directory itself; else a temporary one derived from it. Throws WireError.
[[nodiscard]] std::unique_ptr<wire::Participants> join(const Cell& cell, wire::SessionAddress address);

}  // namespace tactus::latency
