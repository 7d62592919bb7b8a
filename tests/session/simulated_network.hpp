/// The network between the programs of a simulated session. A seed decides which samples it delays, loses, duplicates,
/// reorders or corrupts. The same seed gives the same run.
///
/// Times are virtual, in nanoseconds. Each direction between two programs can be cut until a given time. Reliable
/// delivery retransmits lost samples and delivers each sample once. States are an exception, because a reader needs
/// only the newest: a retransmitted state is not delivered if its writer has sent a newer one. Best-effort delivery
/// does not retransmit lost samples.
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

/// For each kind of fault, the probability that it affects a sample.
struct NetworkFaults {
  double loss = 0;
  double duplication = 0;
  double corruption = 0;  ///< of a chunk's payload
  double reordering = 0;  ///< by an additional delay of at most `reorder_ns`
  std::int64_t reorder_ns = 0;
};

/// A liveness request or answer (session/failure_detector.hpp); its topic has other endpoints than clock samples.
struct LivenessSample {
  session::ClockSample sample;
};
using Sample = std::variant<session::RosterEntry, session::CatalogueEntry, session::Demand, session::BulkChunk,
                            session::ClockSample, LivenessSample>;
/// Describes the sample in one line for a log.
[[nodiscard]] std::string text(const Sample& sample);

class SimulatedNetwork {
 public:
  enum class Reliability : std::uint8_t { kBestEffort, kReliable };
  struct Packet {
    std::int64_t arrival_ns;
    std::uint64_t order;  // number of the packet, which orders packets with equal arrivals
    std::uint64_t from, to;
    std::shared_ptr<const Sample> sample;
    std::uint64_t state_key;  // of a retransmitted state, which a newer state replaces; 0: none
    bool operator>(const Packet& other) const noexcept {
      return arrival_ns != other.arrival_ns ? arrival_ns > other.arrival_ns : order > other.order;
    }
  };

  SimulatedNetwork(std::uint64_t seed, std::int64_t delay_ns, const NetworkFaults& faults);

  void send(std::int64_t now_ns, std::uint64_t from, std::uint64_t to, std::shared_ptr<const Sample> sample,
            Reliability reliability);
  /// Arrival of the next packet; the largest time if none is in flight.
  [[nodiscard]] std::int64_t next_ns() const noexcept;
  /// Removes the next packet and returns it, or nothing if a newer state has replaced it.
  [[nodiscard]] std::optional<Packet> take();
  /// Cuts the direction from `from` to `to` until `until_ns`.
  void cut(std::uint64_t from, std::uint64_t to, std::int64_t until_ns);
  /// Ends all faults and cuts.
  void heal();

  /// When a sample between the two programs was last lost, corrupted, cut off or overtaken.
  [[nodiscard]] std::int64_t last_fault_ns(std::uint64_t a, std::uint64_t b) const;
  [[nodiscard]] std::uint64_t sent() const noexcept { return sent_; }
  [[nodiscard]] const std::array<std::uint64_t, kFaultKinds>& fault_counts() const noexcept { return fault_counts_; }

  /// Receives a line for each sample; may be null.
  std::function<void(std::int64_t now_ns, const std::string&)> trace;

 private:
  using Direction = std::pair<std::uint64_t, std::uint64_t>;
  [[nodiscard]] bool chance(double probability);
  [[nodiscard]] std::int64_t random_below(std::int64_t bound);
  [[nodiscard]] bool is_cut(const Direction& direction, std::int64_t at_ns) const;
  // Each returns the fate of the sample for the trace.
  const char* send_reliably(std::int64_t now_ns, const Direction& direction, std::shared_ptr<const Sample> sample);
  const char* send_best_effort(std::int64_t now_ns, const Direction& direction, std::shared_ptr<const Sample> sample);
  [[nodiscard]] std::shared_ptr<const Sample> corrupted(const session::BulkChunk& chunk);
  void enqueue(std::int64_t arrival_ns, const Direction& direction, std::shared_ptr<const Sample> sample,
               std::uint64_t state_key);
  void record_fault(FaultKind kind, const Direction& direction, std::int64_t at_ns);

  std::mt19937_64 random_;
  std::int64_t delay_ns_;
  NetworkFaults faults_;
  std::priority_queue<Packet, std::vector<Packet>, std::greater<>> in_flight_;
  std::map<Direction, std::int64_t> cuts_;                                     // end of the cut
  std::map<std::pair<Direction, std::uint64_t>, std::uint64_t> newest_order_;  // of the packets with a state key
  std::map<Direction, std::int64_t> last_reliable_ns_;                         // arrival of the last ordered packet
  std::map<Direction, std::int64_t> last_fault_ns_;
  std::uint64_t order_ = 0;
  std::uint64_t sent_ = 0;
  std::array<std::uint64_t, kFaultKinds> fault_counts_{};
};

}  // namespace tactus::test_support
