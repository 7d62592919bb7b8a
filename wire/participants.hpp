/// A program's place in a session: one DDS participant for each traffic class.
///
/// Three classes, three DDS domains: separate sockets, receive threads and locks, so that a stream of meshes does not
/// hold back a probe state. Measured: with one participant for all, p99 of the probe under a saturated link was 61 ms
/// instead of 0.1 ms (docs/reference/qos.md).
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "session/messages.hpp"
#include "wire/error.hpp"

namespace tactus::wire {

enum class TrafficClass { kSession = 0, kProbe = 1, kBulk = 2 };  ///< also the distance from the base domain
inline constexpr int kTrafficClasses = 3;

/// Base domains that can be asked for. 0 is where ROS 2 lives; above, ports would reach the ephemeral ones (32768).
inline constexpr int kMinDomain = 1;
inline constexpr int kMaxDomain = 97;
inline constexpr int kDefaultDomain = 20;

/// Where the profiles are when nothing else is said: `qos/` of the source tree for a program that runs from its build
/// tree, else `share/tactus/qos` beside the program's `bin`.
[[nodiscard]] std::filesystem::path default_qos_directory();

inline constexpr std::uint16_t kDiscoveryServerPort = 11811;

/// How a program finds the others. Nothing named: by multicast, which not every network passes.
struct Discovery {
  /// Machines where others are, by IPv4 address or name: asked one by one, and this machine with them, instead of the
  /// multicast group. Of two that shall meet, one has to name the other.
  std::vector<std::string> peers;
  /// Discovery servers of Fast DDS (`fast-discovery-server -i N -p PORT`), HOST or HOST:PORT, in the order of their ids
  /// from 0. One serves all three domains, and every session: it brings together whoever has a topic in common. Several
  /// stand in for each other.
  std::vector<std::string> servers;
};

/// Who a program is and where it meets the others.
struct SessionAddress {
  std::string session;          ///< 1..kMaxName bytes, without control characters and * ? [ ] / backslash
  std::string participant;      ///< the same; unique in the session
  int domain = kDefaultDomain;  ///< base; the program also uses the next two
  Discovery discovery;
  std::filesystem::path qos = default_qos_directory();
  std::uint64_t incarnation = 0;  ///< 0: larger than at every start before (wire/incarnation.hpp)
  bool one_participant = false;   ///< for all classes, with the profile of class session: to show what that costs
  /// Has no end that writes bulk, so that it need not meet others that have none, of whom there may be many. Where a
  /// discovery server brings together whom it knows, it meets them all the same.
  bool only_reads_bulk = false;
  int probe_priority = 0;  ///< SCHED_FIFO priority of the probe participant's threads, 1..99; 0: as the caller's
};

/// Owns the three participants and the profiles of every topic end. Must outlive its Writers and Readers. Threads: any.
class Participants {
 public:
  /// Reads `address.qos` and joins. Throws WireError for a name or domain out of bounds, a missing or broken profile
  /// (naming file, profile and topic), for a peer or server whose name does not resolve, and when DDS refuses to join.
  /// Takes some 10 ms.
  explicit Participants(SessionAddress address);
  ~Participants();
  Participants(const Participants&) = delete;
  Participants& operator=(const Participants&) = delete;

  [[nodiscard]] const SessionAddress& address() const noexcept;

  /// The origin that every sample sent by this program must bear: session, participant, incarnation and now.
  [[nodiscard]] session::Origin origin() const noexcept;

  /// Whether the probe participant's threads got `probe_priority`; false when it is 0 or the system refused.
  [[nodiscard]] bool probe_is_realtime() const noexcept;

  struct Impl;
  [[nodiscard]] Impl& impl() noexcept { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

/// Where warnings and errors of the DDS library go, for the whole process; dropped while there is no sink. Called from
/// a thread of the library.
void set_log_sink(std::function<void(const std::string&)> sink);

}  // namespace tactus::wire
