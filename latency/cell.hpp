/// One combination of the axes of a latency test, and the grid of combinations from a command line.
#pragma once

#include <array>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace tactus::latency {

/// A test cannot run: wrong settings, or the other side cannot be reached or does not answer.
class LatencyError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class Transport {
  kUdp,      ///< DDS over UDPv4 only, as in the profiles of qos/
  kShm,      ///< DDS over shared memory only
  kBuiltin,  ///< DDS over the library's default transports: shared memory and UDPv4
  kRawUdp,   ///< the reference: the same bytes in a datagram, without DDS
  kCyclone   ///< probe states over Cyclone DDS, if it was available at build time
};
enum class Profile {
  kTactus,  ///< profiles of qos/
  kPlain,   ///< the library's defaults: no policy, DSCP mark or limit is set
  kShared,  ///< the library's defaults, and one participant for all samples of a program
  kTuned    ///< Fast DDS alone, tuned by hand for a link of 100 Mbit/s: a participant for each class, socket marks, one
            ///< frame for each message, and a flow controller of 12 kB/ms for the mesh
};
enum class Topic {
  kProbeState,  ///< tactus_probe_state, traffic class probe
  kRecords      ///< tactus_records, traffic class bulk: the topic of regions
};

enum class Coding {
  kNone,          ///< a ping at each tick of the rate
  kDeadbandCoded  ///< only ticks whose probe state the deadband coder sends (latency/schedule.hpp)
};

inline constexpr std::array kTransportNames{"udp", "shm", "builtin", "raw-udp", "cyclone"};
inline constexpr std::array kProfileNames{"tactus", "plain", "shared", "tuned"};
inline constexpr std::array kTopicNames{"probe_state", "records"};
inline constexpr std::array kCodingNames{"none", "coded"};

inline constexpr std::uint32_t kProbeStateBytes = 236;  ///< an encoded ProbeState; its size is fixed
inline constexpr std::uint32_t kMinPayload = 32;        ///< of a raw datagram and of a record: its timestamps
inline constexpr double kUnpaced = -1;                  ///< load as fast as the writer accepts it

struct Cell {
  Transport transport = Transport::kUdp;
  Profile profile = Profile::kTactus;
  Topic topic = Topic::kProbeState;
  std::uint32_t payload = kProbeStateBytes;  ///< bytes of the sample, without headers of RTPS and UDP
  double rate_hz = 1000;
  Coding coding = Coding::kNone;
  std::uint32_t readers = 1;
  double load_mbit = 0;  ///< mesh records in the direction of the pings, payload only; or kUnpaced
  std::string link = "none";
  double seconds = 5;

  /// Number of ticks; without coding, the number of pings.
  [[nodiscard]] std::uint32_t pings() const noexcept { return static_cast<std::uint32_t>(rate_hz * seconds + 0.5); }
};

/// True when Transport::kCyclone is available.
[[nodiscard]] bool has_cyclone() noexcept;

/// Throws LatencyError for a value out of range or a meaningless combination.
void check(const Cell& cell);

/// "udp tactus probe_state 236 B 1000 Hz x1, load 50 Mbit/s, link P4".
[[nodiscard]] std::string describe(const Cell& cell);

[[nodiscard]] nlohmann::ordered_json to_json(const Cell& cell);
/// Throws LatencyError for a missing member or an invalid value: the text came over the network.
[[nodiscard]] Cell cell_from_json(const nlohmann::ordered_json& json);

/// The values of each axis. Every combination is a cell, in the order of the members, without those that repeat
/// another: raw UDP has neither profile nor topic.
struct Grid {
  std::vector<Transport> transports{Transport::kUdp};
  std::vector<Profile> profiles{Profile::kTactus};
  std::vector<Topic> topics{Topic::kProbeState};
  std::vector<std::uint32_t> payloads;  ///< empty: the size of a probe state
  std::vector<double> rates{1000};
  std::vector<Coding> codings{Coding::kNone};
  std::vector<std::uint32_t> readers{1};
  std::vector<double> loads{0};
  std::vector<std::string> links{"none"};
  double seconds = 5;
  std::uint32_t repeat = 1;  ///< of the whole grid, so that repetitions alternate

  /// Throws LatencyError as `check` does.
  [[nodiscard]] std::vector<Cell> cells() const;
};

}  // namespace tactus::latency
