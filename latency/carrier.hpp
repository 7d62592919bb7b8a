/// Carriers send and receive pings and echoes over one transport: raw UDP, a topic of Tactus through wire/, or Cyclone
/// DDS.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "latency/test_case.hpp"
#include "wire/participants.hpp"

namespace tactus::latency {

/// A ping or its echo. Times are on the sender's monotonic clock.
struct Packet {
  std::uint32_t sequence = 0;
  std::uint32_t reader = 0;   ///< of an echo: number of the echoer that sends it
  std::int64_t event_ns = 0;  ///< ping: intended time of sending; echo: time of arrival of its ping
  std::int64_t sent_ns = 0;   ///< time of the send call
};
/// Called in a thread of the carrier, one call at a time; may send on the same carrier. `arrived_ns` is on the
/// receiver's monotonic clock.
using OnPacket = std::function<void(const Packet&, std::int64_t arrived_ns)>;

enum class Role { kPinger, kEchoer };

/// One end of a transport. Destroying it ends its thread; no callback runs after that.
class Carrier {
 public:
  virtual ~Carrier() = default;
  /// Returns false when the transport refused the packet. A ping goes to every echoer. One thread at a time.
  virtual bool send(const Packet& packet) noexcept = 0;
  /// Number of matched echoers at the pinger, or of pingers at an echoer.
  [[nodiscard]] virtual std::uint32_t matched() const noexcept = 0;
};

struct UdpSettings {
  std::string echo_address;               ///< pinger only: IPv4 address or name of the echoers' machine
  std::vector<std::uint16_t> echo_ports;  ///< pinger only
  int priority = 0;                       ///< SCHED_FIFO of the receiving thread; 0: none
};
/// Throws LatencyError that names the call that the system refuses.
[[nodiscard]] std::unique_ptr<Carrier> make_udp(Role role, std::uint32_t payload, const UdpSettings& settings,
                                                OnPacket callback);
/// Port of an echoer that make_udp made.
[[nodiscard]] std::uint16_t port_of(const Carrier& udp);

/// Bytes of a mesh chunk with Profile::kTuned or Cyclone DDS: with all headers it fills at most one frame.
inline constexpr std::uint32_t kTunedChunkBytes = 1300;

/// The sending end of the load: mesh traffic during the pings.
class LoadSource {
 public:
  virtual ~LoadSource() = default;
  [[nodiscard]] virtual bool matched() const noexcept = 0;
  /// Starts sending. Call once, when matched() is true.
  virtual void start() = 0;
};
/// The receiving end of the load.
class LoadSink {
 public:
  virtual ~LoadSink() = default;
  /// Payload received after the first arrival, divided by the time from the first to the last arrival, or by the
  /// duration of the test if that is longer.
  [[nodiscard]] virtual double bytes_per_s() = 0;
};

/// Makes a carrier of probe states over Cyclone DDS, with the IDL of Tactus. It is tuned by hand: best effort, and the
/// socket marks of qos/flow.yaml. The load must have another domain than the carrier, so that they share no socket and
/// no thread. The carrier's threads get SCHED_FIFO `priority` if the system allows it. Requires has_cyclone(). Throws
/// LatencyError.
[[nodiscard]] std::unique_ptr<Carrier> make_cyclone(Role role, int domain, int priority, OnPacket callback);
/// Makes a load over Cyclone DDS: reliable chunks of one frame, as fast as the writer accepts them. Requires
/// has_cyclone(). `seconds`: duration of the test. Throws LatencyError.
[[nodiscard]] std::unique_ptr<LoadSource> make_cyclone_load(int domain);
[[nodiscard]] std::unique_ptr<LoadSink> make_cyclone_sink(int domain, double seconds);

/// Makes a carrier over the DDS topic of `test`. Pings and echoes have different DDS partitions. `participants` must
/// outlive the carrier. Throws WireError.
[[nodiscard]] std::unique_ptr<Carrier> make_dds(Role role, const TestCase& test, wire::Participants& participants,
                                                OnPacket callback);

/// Joins a session with the transport and profile of `test`. With profile tactus over UDP it uses the directory
/// `address.qos`, otherwise a temporary copy that is adapted to transport and profile. Throws WireError.
[[nodiscard]] std::unique_ptr<wire::Participants> join_session(const TestCase& test, wire::SessionAddress address);

}  // namespace tactus::latency
