/// Records the inputs and the results of each cycle, so that a replay can compute the forces again.
///
///   CycleObserver: stop, reset, move, touch, refine --> [one record a cycle] --ring--> FlightStore: last seconds, file
///
/// A record holds the calls in order, as the structs of trace/flight_file.hpp. At intervals it also holds the state
/// that the cycle passes to the next one, so that a recording can begin there. The record enters the ring as a whole
/// after the cycle's refinement. When the ring is full, the cycle is lost, but its arrived and departed regions are
/// retained; the next record that fits states how many cycles were lost and holds the state after them. A cycle with a
/// full ring of departures also counts as lost, because its departures then depend on another thread.
///
/// The haptic thread calls the realtime functions, one other thread calls `next`.
#pragma once

#include <array>
#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "hrtc_service/cycle.hpp"
#include "spm/forest.hpp"
#include "trace/flight_file.hpp"

namespace tactus::hrtc_service {

/// The content of an entry of a record.
enum class FlightEntry : std::uint32_t {
  kEvent,   ///< trace::FlightEvent
  kObject,  ///< as kEvent, then a FlightNewObject
  kMove,    ///< trace::FlightMove
  kProbe,   ///< trace::FlightProbe
  kTouch,   ///< trace::FlightTouch
  kRefine,  ///< trace::FlightRefine
  kLost,    ///< count of lost cycles, 64 bits; then only events, and at last kState
  kState    ///< see FlightRecorder::put_state
};

/// The constant properties of an object. The haptic thread copies them, since the object may be freed before they are
/// read.
struct FlightNewObject {
  std::uint64_t id = 0, digest = 0;
  Placement::Numbers placement{};
  session::Material material;
  std::uint32_t object = 0, movable = 0;
  std::array<char, session::kMaxName + 1> name{};
};
static_assert(std::is_trivially_copyable_v<FlightNewObject> && sizeof(FlightNewObject) % 8 == 0);

/// 64-bit words: the number of words, this one included; then entries, each as kind << 32 | length, and its words.
using FlightRecord = std::vector<std::uint64_t>;

class FlightRecorder final : public CycleObserver {
 public:
  static constexpr std::uint32_t kRingWords = 1u << 18;  ///< 2 MiB: 0.8 s of eight probes at 1 kHz
  static constexpr std::uint32_t kMaxInUse = 1u << 12;   ///< regions of an object; with more, no state is recorded
  static constexpr std::uint32_t kMaxWords = 1u << 15;   ///< of a record; a longer record is lost
  /// Words of the events that are retained while cycles are lost, some 4000; with more, recording ends.
  static constexpr std::uint32_t kMaxEventWords = 1u << 14;

  /// `state_every`: cycles from one state to the next. Allocates 2.5 MiB and touches all of it.
  explicit FlightRecorder(std::uint32_t state_every);

  void stopped(haptics::Fault fault) noexcept override;
  void reset() noexcept override;
  void moved(const TouchObject& object, const Placement& placement) noexcept override;
  void touched(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns, const Arrival* arrivals,
               std::uint32_t arrival_count, const CycleResult& result) noexcept override;
  /// Ends the record.
  void refined(Cycle& cycle, std::span<const Departure> left, bool departures_fit) noexcept override;

  /// The next record, if there is one. Allocates.
  [[nodiscard]] bool next(FlightRecord& record);
  /// Cycles lost when recording ended because of too many events; 0: it still records.
  [[nodiscard]] std::uint64_t ended() const noexcept { return ended_.load(std::memory_order_relaxed); }

 private:
  template <class Value>
  void put(FlightEntry kind, const Value& value) noexcept;
  [[nodiscard]] bool has_room(std::uint32_t words) noexcept;
  void put_event(trace::FlightEvent::Kind kind, std::uint32_t object, spm::RegionId region,
                 const TouchObject* came = nullptr) noexcept;
  [[nodiscard]] bool put_state(Cycle& cycle) noexcept;
  [[nodiscard]] bool push() noexcept;

  boost::lockfree::spsc_queue<std::uint64_t> ring_;
  std::vector<std::uint64_t> words_;   // of the current record; the first holds its size
  std::vector<std::uint64_t> events_;  // arrivals and departures of this cycle and of the lost cycles before it
  std::vector<spm::Forest::InUse> in_use_;
  std::uint32_t count_ = 1, event_count_ = 0;  // words
  std::uint32_t state_every_, since_state_ = 0;
  std::uint64_t cycle_ = 0, lost_ = 0;
  bool broken_ = false;  // the record does not fit
  std::atomic<std::uint64_t> ended_{0};
};

/// Combines the hash of the objects before, 0 for none, with that of one more object's active mesh.
[[nodiscard]] constexpr std::uint64_t flight_hash(std::uint64_t before, std::uint64_t mesh_hash) noexcept {
  return before * 0x100000001b3u + mesh_hash;
}

}  // namespace tactus::hrtc_service
