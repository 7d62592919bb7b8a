/// A program's participants in a session: one DDS participant for each traffic class.
///
/// Three classes use three DDS domains: separate sockets, receive threads and locks, so that a mesh transfer does not
/// delay probe states. Measured: with one participant for all, p99 of the probe under a saturated link was 61 ms; with
/// one for each class 0.1 ms (docs/reference/qos.md).
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

enum class TrafficClass { kSession = 0, kProbe = 1, kBulk = 2 };  ///< also the offset from the base domain
inline constexpr int kTrafficClasses = 3;

/// Valid base domains. ROS 2 uses domain 0; above the max, ports would reach the ephemeral ones (32768).
inline constexpr int kMinDomain = 1;
inline constexpr int kMaxDomain = 97;
inline constexpr int kDefaultDomain = 20;

/// Default directory of the profiles: `qos/` of the source tree for a program that runs from its build tree, else
/// `share/tactus/qos` beside the program's `bin`.
[[nodiscard]] std::filesystem::path default_qos_directory();

inline constexpr std::uint16_t kDiscoveryServerPort = 11811;

/// How a program discovers others. Empty: by multicast, which not every network forwards.
struct Discovery {
  /// IPv4 addresses or names of machines. The program announces itself to each of them and to this machine, instead of
  /// the multicast group. Of two programs, one has to name the other's machine.
  std::vector<std::string> peers;
  /// Discovery servers of Fast DDS (`fast-discovery-server -i N -p PORT`), HOST or HOST:PORT, in the order of their ids
  /// from 0. One server serves all three domains and every session. Further servers are redundant.
  std::vector<std::string> servers;
};

/// The identity of a program and its session.
struct SessionAddress {
  std::string session;          ///< 1..kMaxName bytes, without control characters and * ? [ ] / backslash
  std::string participant;      ///< the same; unique in the session
  int domain = kDefaultDomain;  ///< base domain; the program also uses the next two
  Discovery discovery;
  std::filesystem::path qos = default_qos_directory();
  std::uint64_t incarnation = 0;  ///< 0: a new one is made (wire/incarnation.hpp)
  bool one_participant = false;   ///< for all classes, with the profile of class session; only to measure its cost
  /// The program writes no bulk topic, so it ignores other participants that only read bulk; there may be many. With a
  /// discovery server this has no effect.
  bool only_reads_bulk = false;
  int probe_priority = 0;  ///< SCHED_FIFO priority of the probe participant's threads, 1..99; 0: the caller's
};

/// Owns the three participants and the profiles of every endpoint. Must outlive its Writers and Readers. Threads: any.
class Participants {
 public:
  /// Reads `address.qos` and joins; takes about 10 ms. Throws WireError for a name or domain out of bounds, a missing
  /// or broken profile (with file, profile and topic), a peer or server whose name does not resolve, and when DDS
  /// cannot join.
  explicit Participants(SessionAddress address);
  ~Participants();
  Participants(const Participants&) = delete;
  Participants& operator=(const Participants&) = delete;

  [[nodiscard]] const SessionAddress& address() const noexcept;

  /// The origin for a sample that this program sends now: session, participant, incarnation and time.
  [[nodiscard]] session::Origin origin() const noexcept;

  /// Whether the probe participant's threads run at `probe_priority`; false when it is 0 or the system refused.
  [[nodiscard]] bool probe_is_realtime() const noexcept;

  struct Impl;
  [[nodiscard]] Impl& impl() noexcept { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

/// Sets the sink for warnings and errors of the DDS library, for the whole process; without a sink they are dropped.
/// Called from a thread of the library.
void set_log_sink(std::function<void(const std::string&)> sink);

}  // namespace tactus::wire
