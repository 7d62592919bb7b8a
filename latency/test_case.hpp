/// The settings of one latency test, and the grid of all combinations of settings from a command line.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace tactus::latency {

/// Wrong settings of a test, or a remote side that cannot be reached or does not answer.
class LatencyError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class Transport {
  kUdp,      ///< Fast DDS over UDPv4 only, as in the profiles of qos/
  kShm,      ///< Fast DDS over shared memory only
  kBuiltin,  ///< Fast DDS over its default transports: shared memory and UDPv4
  kRawUdp,   ///< UDP datagrams of the same payload without DDS: the reference for the other transports
  kCyclone   ///< Cyclone DDS, if it was available at build time; probe states only
};
enum class Profile {
  kTactus,  ///< profiles of qos/
  kPlain,   ///< the library's defaults: no QoS policy of Tactus, no DSCP mark, no rate limit
  kShared,  ///< the library's defaults, with one participant for all traffic classes
  kTuned    ///< Fast DDS tuned by hand for a link of 100 Mbit/s, without the pacer of Tactus: a participant for each
            ///< class, socket marks, one frame for each message, and a flow controller of 12 kB/ms for the mesh
};
enum class Topic {
  kProbeState,  ///< tactus_probe_state, traffic class probe
  kRecords      ///< tactus_records, traffic class bulk
};

enum class Coding {
  kNone,          ///< a ping at each tick of the rate
  kDeadbandCoded  ///< a ping at each tick whose probe state the deadband coder sends (latency/schedule.hpp)
};

inline constexpr std::array kTransportNames{"udp", "shm", "builtin", "raw-udp", "cyclone"};
inline constexpr std::array kProfileNames{"tactus", "plain", "shared", "tuned"};
inline constexpr std::array kTopicNames{"probe_state", "records"};
inline constexpr std::array kCodingNames{"none", "coded"};

inline constexpr std::uint32_t kProbeStateBytes = 236;  ///< size of every encoded ProbeState
inline constexpr std::uint32_t kMinPayload = 32;        ///< bytes that the timestamps need in a raw datagram or record
inline constexpr double kUnpaced = -1;                  ///< value of load_mbit: as fast as the writer accepts chunks

struct TestCase {
  Transport transport = Transport::kUdp;
  Profile profile = Profile::kTactus;
  Topic topic = Topic::kProbeState;
  std::uint32_t payload = kProbeStateBytes;  ///< bytes of a probe state, a raw datagram, or the piece in a chunk
  double rate_hz = 1000;
  Coding coding = Coding::kNone;
  std::uint32_t readers = 1;
  double load_mbit = 0;  ///< payload of mesh records in the direction of the pings, Mbit/s; or kUnpaced
  std::string link = "none";
  double seconds = 5;

  /// Number of ticks of the rate. Without coding, each tick has a ping.
  [[nodiscard]] std::uint32_t ticks() const noexcept { return static_cast<std::uint32_t>(rate_hz * seconds + 0.5); }
};

/// Returns whether Transport::kCyclone is available.
[[nodiscard]] bool has_cyclone() noexcept;

/// Throws LatencyError for a value out of range or a meaningless combination.
void check(const TestCase& test);

/// Returns a text such as "udp tactus probe_state 236 B 1000 Hz x1, load 50 Mbit/s, link P4".
[[nodiscard]] std::string describe(const TestCase& test);

[[nodiscard]] nlohmann::ordered_json to_json(const TestCase& test);
/// Throws LatencyError for a missing member or an invalid value, because the text may come over the network.
[[nodiscard]] TestCase test_from_json(const nlohmann::ordered_json& json);

/// The values of each setting. Every combination is a test. Raw UDP and Cyclone DDS have no profile and no topic, so
/// each has one test for all profiles and topics.
struct Grid {
  std::vector<Transport> transports{Transport::kUdp};
  std::vector<Profile> profiles{Profile::kTactus};
  std::vector<Topic> topics{Topic::kProbeState};
  std::vector<std::uint32_t> payloads;  ///< bytes; empty: the size of a probe state
  std::vector<double> rates{1000};
  std::vector<Coding> codings{Coding::kNone};
  std::vector<std::uint32_t> readers{1};
  std::vector<double> loads{0};
  std::vector<std::string> links{"none"};
  double seconds = 5;
  std::uint32_t repetitions = 1;  ///< of the whole grid

  /// Throws LatencyError as `check` does.
  [[nodiscard]] std::vector<TestCase> tests() const;
};

}  // namespace tactus::latency
