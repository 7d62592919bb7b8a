/// The network between the programs of a simulated session: delays, loses, doubles, reorders and corrupts by a seed.
///
/// Virtual time in nanoseconds. Each way between two programs may be cut for a while, one way alone too. What is sent
/// over the reliable carrier arrives once and in order, later for each time that it was lost, or, of a state, not at
/// all when a newer one replaces it before it could be repeated; over the lossy one as it comes. Same seed, same run.
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

/// Whether a host lives (session/failure_detector.hpp): over ends of its own, so that it is no question for the time.
struct FailureDetectorSample {
  session::ClockSample sample;
};
using Sample = std::variant<session::RosterEntry, session::CatalogueEntry, session::Demand, session::BulkChunk,
                            session::ClockSample, FailureDetectorSample>;
/// One line of a log.
[[nodiscard]] std::string text(const Sample& sample);

class SimulatedNetwork {
 public:
  enum class Carrier : std::uint8_t { kLossy, kReliable };
  struct Packet {
    std::int64_t at_ns;
    std::uint64_t order;
    std::uint64_t from, to;
    std::shared_ptr<const Sample> sample;
    std::uint64_t state;  // repeated, and gives way to a newer state under this key; 0: does not
    bool operator>(const Packet& other) const noexcept {
      return at_ns != other.at_ns ? at_ns > other.at_ns : order > other.order;
    }
  };

  SimulatedNetwork(std::uint64_t seed, std::int64_t delay_ns, const NetworkFaults& faults);

  void send(std::int64_t now_ns, std::uint64_t from, std::uint64_t to, std::shared_ptr<const Sample> sample,
            Carrier carrier);
  /// When the next packet arrives; none under way: never.
  [[nodiscard]] std::int64_t next_ns() const noexcept;
  /// That packet; none when a newer one has replaced it.
  [[nodiscard]] std::optional<Packet> take();
  /// Nothing of `from` reaches `to` until then.
  void cut(std::uint64_t from, std::uint64_t to, std::int64_t until_ns);
  /// No faults and no cuts from now on.
  void heal();

  /// When something sent between these two was lost, damaged, cut off or overtaken last.
  [[nodiscard]] std::int64_t last_harm_ns(std::uint64_t a, std::uint64_t b) const;
  [[nodiscard]] std::uint64_t sent() const noexcept { return sent_; }
  [[nodiscard]] const std::array<std::uint64_t, kFaultKinds>& faults_done() const noexcept { return done_; }

  /// Gets a line for each sample; null: none.
  std::function<void(std::int64_t now_ns, const std::string&)> trace;

 private:
  using Way = std::pair<std::uint64_t, std::uint64_t>;
  [[nodiscard]] bool chance(double p);
  [[nodiscard]] std::int64_t below(std::int64_t n);
  [[nodiscard]] bool cut_off(const Way& way, std::int64_t at_ns) const;
  void arrive(std::int64_t at_ns, const Way& way, std::shared_ptr<const Sample> sample, std::uint64_t state);
  void count(FaultKind kind) { ++done_[static_cast<std::size_t>(kind)]; }
  void harm(const Way& way, std::int64_t now_ns);

  std::mt19937_64 random_;
  std::int64_t delay_ns_;
  NetworkFaults faults_;
  std::priority_queue<Packet, std::vector<Packet>, std::greater<>> under_way_;
  std::map<Way, std::int64_t> cuts_;                               // until
  std::map<std::pair<Way, std::uint64_t>, std::uint64_t> newest_;  // order of the newest state under a key
  std::map<Way, std::int64_t> last_arrival_;                       // of what went over the reliable carrier
  std::map<Way, std::int64_t> harmed_;                             // last
  std::uint64_t order_ = 0;
  std::uint64_t sent_ = 0;
  std::array<std::uint64_t, kFaultKinds> done_{};
};

}  // namespace tactus::test_support
