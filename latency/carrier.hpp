/// Transports of pings and echoes: raw UDP, a topic of Tactus through wire/, or Cyclone DDS.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "latency/cell.hpp"
#include "wire/participants.hpp"

namespace tactus::latency {

/// A ping or its echo. Times are on the sender's monotonic clock.
struct Packet {
  std::uint32_t sequence = 0;
  std::uint32_t reader = 0;   ///< of an echo: its sender
  std::int64_t event_ns = 0;  ///< ping: intended time of sending; echo: arrival of the ping
  std::int64_t sent_ns = 0;   ///< time of the send call
};
/// Called in a thread of the carrier, one call at a time; may send on the same carrier. `arrived_ns`: our monotonic
/// clock.
using OnPacket = std::function<void(const Packet&, std::int64_t arrived_ns)>;

enum class Part { kPinger, kEchoer };

/// One end of a transport. Destroying it ends its thread; no callback runs after that.
class Carrier {
 public:
  virtual ~Carrier() = default;
  /// False when the transport refused it. A ping goes to every echoer. One thread at a time.
  virtual bool send(const Packet& packet) noexcept = 0;
  /// Number of echoers, or pingers, found.
  [[nodiscard]] virtual std::uint32_t matched() const noexcept = 0;
};

/// Address and settings of one end over UDP.
struct UdpSettings {
  std::string echo_address;               ///< pinger only: IPv4 address or name of the echoers' machine
  std::vector<std::uint16_t> echo_ports;  ///< pinger only
  int priority = 0;                       ///< SCHED_FIFO of the receiving thread; 0: none
};
/// Throws LatencyError naming what the system refuses.
[[nodiscard]] std::unique_ptr<Carrier> make_udp(Part part, std::uint32_t payload, const UdpSettings& side,
                                                OnPacket callback);
/// The port of an echoer made by make_udp.
[[nodiscard]] std::uint16_t port_of(const Carrier& udp);

inline constexpr std::uint32_t kPeerChunkBytes = 1300;  ///< of a tuned peer's load: one frame with all headers

/// The sending end of the mesh traffic beside the pings.
class LoadSource {
 public:
  virtual ~LoadSource() = default;
  [[nodiscard]] virtual bool matched() const noexcept = 0;
  /// Call once, after matched().
  virtual void start() = 0;
};
class LoadSink {
 public:
  virtual ~LoadSink() = default;
  /// Payload between the first and the last arrival, per second; 0 with fewer than two.
  [[nodiscard]] virtual double bytes_per_s() = 0;
};

/// Probe states over Cyclone DDS, from the same IDL, tuned by hand: best effort, socket marks as ours, and a domain of
/// their own, so that they share no socket and no thread with the load. Threads get SCHED_FIFO `priority` if allowed.
/// Throws LatencyError; requires has_cyclone().
[[nodiscard]] std::unique_ptr<Carrier> make_cyclone(Part part, int domain, int priority, OnPacket callback);
/// Chunks of one frame over Cyclone DDS, reliable, as fast as its writer accepts them. Likewise.
[[nodiscard]] std::unique_ptr<LoadSource> make_cyclone_load(int domain);
[[nodiscard]] std::unique_ptr<LoadSink> make_cyclone_sink(int domain);

/// A DDS topic of `cell` with its own profiles; `participants` must outlive it. Pings and echoes each have a partition.
/// Throws WireError.
[[nodiscard]] std::unique_ptr<Carrier> make_dds(Part part, const Cell& cell, wire::Participants& participants,
                                                OnPacket callback);

/// Joins a session with the transport and profile of `cell`. For `tactus` and `udp` it uses the qos directory itself,
/// otherwise a temporary copy with changes. Throws WireError.
[[nodiscard]] std::unique_ptr<wire::Participants> join(const Cell& cell, wire::SessionAddress address);

}  // namespace tactus::latency
