/// Names a program and its session, and how it discovers others. Without the DDS library, so that a program without DDS
/// can read the options of one with DDS.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace tactus::wire {

enum class TrafficClass { kSession = 0, kProbe = 1, kBulk = 2 };  ///< also the offset from the base domain
inline constexpr int kTrafficClasses = 3;

/// Valid base domains. ROS 2 uses domain 0. The max keeps all ports below the ephemeral ports, which begin at 32768:
/// domain X has the ports from 7400 + 250 X to 7649 + 250 X, and the session also uses the next two domains.
inline constexpr int kMinDomain = 1;
inline constexpr int kMaxDomain = (32768 - 7650) / 250 - (kTrafficClasses - 1);
inline constexpr int kDefaultDomain = 20;

/// Default directory of the profiles. For a program in its build tree, this is `qos/` of the source tree. For others,
/// it is `share/tactus/qos` next to the program's `bin` or `libexec`; if that does not exist, the directory chosen at
/// build time.
[[nodiscard]] std::filesystem::path default_qos_directory();

inline constexpr std::uint16_t kDiscoveryServerPort = 11811;

/// The method by which a program discovers others. Without peers and servers: multicast, which not every network
/// forwards.
struct Discovery {
  /// IPv4 addresses or names of machines. The program announces itself to each of them and to its own machine, instead
  /// of to the multicast group. For two programs to meet, one of them has to name the machine of the other.
  std::vector<std::string> peers;
  /// Discovery servers of Fast DDS (`fast-discovery-server -i N -p PORT`), as HOST or HOST:PORT, in the order of their
  /// ids N from 0. One server serves all three domains and all sessions. Additional servers are redundant.
  std::vector<std::string> servers;
  /// True: a peer whose name does not resolve within 2 s is reported and left out, if another one resolves.
  bool skips_unknown_peers = false;
};

/// The name of a program with keys is that of its keys, or NAME.INSTANCE for several programs with the same keys.
enum class Naming {
  kGiven,    ///< with keys, the name must be NAME or NAME.INSTANCE
  kInstance  ///< with keys, the name is an INSTANCE, and NAME is put before it
};

/// The identity of a program and its session.
struct SessionAddress {
  std::string session;      ///< 1..kMaxName bytes, without control characters and * ? [ ] / backslash
  std::string participant;  ///< name with the same rules; unique in the session
  Naming naming = Naming::kGiven;
  int domain = kDefaultDomain;  ///< base domain; the program also uses the next two
  Discovery discovery;
  std::filesystem::path qos = default_qos_directory();
  /// Folder of this program's keys, which `tactus keys` has made. All programs of a session have keys of one authority.
  /// Empty: no encryption. Then the program takes part only with programs of its own machine. With `plain` it also
  /// takes part with other machines, and everyone who reaches the network can read and write the session.
  std::filesystem::path keys;
  bool plain = false;    ///< true: without keys, also with programs of other machines; each program warns
  bool is_test = false;  ///< true: as `plain`, without a warning: the session of a test, which has nothing to protect
  /// With keys, the file of the audit log (wire/audit.hpp). Empty: SESSION.NAME.jsonl in `audit` of the state folder
  /// (wire/incarnation.hpp).
  std::filesystem::path audit;
  std::uint64_t incarnation = 0;  ///< 0: a new number is issued (wire/incarnation.hpp)
  /// True: one DDS participant for all classes, with the profile of class session; for measurements.
  bool one_participant = false;
  /// True: the program writes no bulk topic, so its bulk participant ignores the bulk participants of other such
  /// programs, of which there may be many. Has no effect with a discovery server.
  bool only_reads_bulk = false;
  int probe_priority = 0;  ///< SCHED_FIFO priority of the probe participant's threads, 1..99; 0: as the calling thread
};

}  // namespace tactus::wire
