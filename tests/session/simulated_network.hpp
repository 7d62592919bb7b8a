/// The network between the programs of a simulated session: delays, loses, repeats, reorders and corrupts by a seed.
///
/// Virtual time in nanoseconds. Each direction between two programs can be cut for a while. The reliable carrier
/// delivers once and in order, later for each loss; a state that a newer one replaces before its repetition is not
/// delivered. The lossy carrier delivers what arrives. The same seed gives the same run.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <queue>
#include <random>
#include <string>
#include <variant>
#include <vector>

#include "session/messages.hpp"

namespace tactus::test_support {

enum class FaultKind : std::uint8_t { kLoss, kReordering, kDuplication, kCorruption, kCrash, kRestart, kPartition };
inline constexpr std::size_t kFaultKinds = 7;
inline constexpr std::array<const char*, kFaultKinds> kFaultNames{"loss",  "reordering", "duplication", "corruption",
                                                                  "crash", "restart",    "partition"};

/// Chances are per sample.
struct NetworkFaults {
  double loss = 0;
  double duplication = 0;
  double corruption = 0;  ///< of a chunk's payload
  double reordering = 0;  ///< a further delay of up to `reorder_ns`
  std::int64_t reorder_ns = 0;
};

/// A liveness request or answer (session/failure_detector.hpp); its topic has other endpoints than clock samples.
struct LivenessSample {
  session::ClockSample sample;
};
using Sample = std::variant<session::RosterEntry, session::CatalogueEntry, session::Demand, session::BulkChunk,
                            session::ClockSample, LivenessSample>;
/// One line for a log.
[[nodiscard]] std::string text(const Sample& sample);

class SimulatedNetwork {
 public:
  enum class Carrier : std::uint8_t { kLossy, kReliable };
  struct Packet {
    std::int64_t at_ns;
    std::uint64_t order;
    std::uint64_t from, to;
    std::shared_ptr<const Sample> sample;
    std::uint64_t state;  // key of a repeated state, which a newer state replaces; 0: none
    bool operator>(const Packet& other) const noexcept {
      return at_ns != other.at_ns ? at_ns > other.at_ns : order > other.order;
    }
  };

  SimulatedNetwork(std::uint64_t seed, std::int64_t delay_ns, const NetworkFaults& faults);

  void send(std::int64_t now_ns, std::uint64_t from, std::uint64_t to, std::shared_ptr<const Sample> sample,
            Carrier carrier);
  /// Arrival of the next packet; the max time if none is in flight.
  [[nodiscard]] std::int64_t next_ns() const noexcept;
  /// That packet; none when a newer state has replaced it.
  [[nodiscard]] std::optional<Packet> take();
  /// Cuts the direction from `from` to `to` until then.
  void cut(std::uint64_t from, std::uint64_t to, std::int64_t until_ns);
  /// No faults and no cuts from now on.
  void heal();

  /// When a sample between these two was last lost, damaged, cut off or overtaken.
  [[nodiscard]] std::int64_t last_harm_ns(std::uint64_t a, std::uint64_t b) const;
  [[nodiscard]] std::uint64_t sent() const noexcept { return sent_; }
  [[nodiscard]] const std::array<std::uint64_t, kFaultKinds>& faults_done() const noexcept { return done_; }

  /// Receives a line for each sample; may be null.
  std::function<void(std::int64_t now_ns, const std::string&)> trace;

 private:
  using Direction = std::pair<std::uint64_t, std::uint64_t>;
  [[nodiscard]] bool chance(double p);
  [[nodiscard]] std::int64_t below(std::int64_t n);
  [[nodiscard]] bool cut_off(const Direction& direction, std::int64_t at_ns) const;
  void arrive(std::int64_t at_ns, const Direction& direction, std::shared_ptr<const Sample> sample,
              std::uint64_t state);
  void count(FaultKind kind) { ++done_[static_cast<std::size_t>(kind)]; }
  void harm(const Direction& direction, std::int64_t now_ns);

  std::mt19937_64 random_;
  std::int64_t delay_ns_;
  NetworkFaults faults_;
  std::priority_queue<Packet, std::vector<Packet>, std::greater<>> in_flight_;
  std::map<Direction, std::int64_t> cuts_;                               // end of the cut
  std::map<std::pair<Direction, std::uint64_t>, std::uint64_t> newest_;  // order of the newest state with a key
  std::map<Direction, std::int64_t> last_arrival_;                       // over the reliable carrier
  std::map<Direction, std::int64_t> harmed_;                             // time of the last harm
  std::uint64_t order_ = 0;
  std::uint64_t sent_ = 0;
  std::array<std::uint64_t, kFaultKinds> done_{};
};

}  // namespace tactus::test_support
