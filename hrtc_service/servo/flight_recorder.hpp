/// Records the inputs and the results of each cycle, so that a replay can compute the forces again.
///
///   CycleObserver: stop, reset, move, touch, refine --> [one record a cycle] --ring--> FlightStore: last seconds, file
///
/// A record contains the calls that one cycle makes to its observer, in order, as structs of trace/flight_file.hpp. At
/// intervals it also contains the state that the cycle passes to the next one, so that a recording can begin there.
///
/// The record is pushed to the ring after the cycle's refinement. If the ring is full, the cycle is lost, but the
/// recorder stores its arrivals and departures. When half of the ring is free again, the next record contains the
/// number of lost cycles, their arrivals and departures, and the state after them. A cycle also counts as lost if the
/// ring of departures is full. The departures of such a cycle depend on how fast the loader empties that ring, which a
/// replay cannot know.
///
/// The haptic thread calls the observer's functions, one other thread calls `next`.
#pragma once

#include <array>
#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <span>
#include <type_traits>
#include <vector>

#include "hrtc_service/servo/cycle.hpp"
#include "spm/forest.hpp"
#include "trace/flight_file.hpp"

namespace tactus::hrtc_service {

/// Kind of an entry of a record. The comment of each kind states the content of the entry.
enum class FlightEntry : std::uint32_t {
  kEvent,   ///< trace::FlightEvent
  kObject,  ///< trace::FlightEvent, then FlightNewObject
  kMove,    ///< trace::FlightMove
  kProbe,   ///< trace::FlightProbe
  kTouch,   ///< trace::FlightTouch
  kRefine,  ///< trace::FlightRefine
  kLost,    ///< number of lost cycles, 64 bits; only events and kState follow in this record
  kState    ///< see FlightRecorder::put_state
};

/// The constant properties of an object. The haptic thread copies them, because the object may be freed before the
/// record is read.
struct FlightNewObject {
  std::uint64_t id = 0, digest = 0;
  Placement::Numbers placement{};
  session::Material material;
  std::uint32_t object = 0, movable = 0;
  std::array<char, session::kMaxName + 1> name{};
};
static_assert(std::is_trivially_copyable_v<FlightNewObject> && sizeof(FlightNewObject) % 8 == 0);

/// A record of 64-bit words: the number of words including this one, then entries. An entry begins with
/// kind << 32 | length, and `length` further words follow.
using FlightRecord = std::vector<std::uint64_t>;

class FlightRecorder final : public CycleObserver {
 public:
  static constexpr std::uint32_t kRingWords = 1u << 18;  ///< 2 MiB, for 0.8 s of eight probes at 1 kHz
  /// Max number of regions in use per object (Forest::InUse). If an object has more, no state is recorded.
  static constexpr std::uint32_t kMaxInUse = 1u << 12;
  static constexpr std::uint32_t kMaxWords = 1u << 15;  ///< max length of a record; a longer record is lost
  /// Max words of the events that are stored while cycles are lost, some 4000 events. If there are more, recording
  /// ends.
  static constexpr std::uint32_t kMaxEventWords = 1u << 14;

  /// `state_period`: number of cycles from one recorded state to the next. Allocates 2.5 MiB and writes to all of it,
  /// so that the haptic thread has no page faults there.
  explicit FlightRecorder(std::uint32_t state_period);

  void stopped(haptics::Fault fault) noexcept override;
  void reset() noexcept override;
  void moved(const TouchObject& object, const Placement& placement) noexcept override;
  void touched(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns, const Arrival* arrivals,
               std::uint32_t arrival_count, const CycleResult& result) noexcept override;
  /// Completes the record of the cycle and pushes it.
  void refined(Cycle& cycle, std::span<const Departure> departed, bool departures_fit) noexcept override;

  /// Sets `record` to the next record. Returns false if there is none. Allocates.
  [[nodiscard]] bool next(FlightRecord& record);
  /// Returns 0 while the recorder records. When too many events have ended the recording, returns the number of cycles
  /// that were lost until then.
  [[nodiscard]] std::uint64_t lost_at_end() const noexcept { return lost_at_end_.load(std::memory_order_relaxed); }

 private:
  template <class Value>
  void put(FlightEntry kind, const Value& value) noexcept;
  [[nodiscard]] bool has_room(std::uint32_t words) noexcept;
  void put_event(trace::FlightEvent::Kind kind, std::uint32_t object, spm::RegionId region,
                 const TouchObject* new_object = nullptr) noexcept;
  [[nodiscard]] bool put_state(Cycle& cycle) noexcept;
  [[nodiscard]] bool push() noexcept;

  boost::lockfree::spsc_queue<std::uint64_t> ring_;
  std::vector<std::uint64_t> words_;   // of the current record; the first holds its size
  std::vector<std::uint64_t> events_;  // arrivals and departures of this cycle and of the lost cycles before it
  std::vector<spm::Forest::InUse> in_use_;
  std::uint32_t count_ = 1, event_count_ = 0;  // words
  std::uint32_t state_period_, cycles_since_state_ = 0;
  std::uint64_t cycle_ = 0, lost_ = 0;  // number of the current cycle; number of lost cycles not yet recorded
  bool is_too_long_ = false;            // the current record does not fit into kMaxWords
  std::atomic<std::uint64_t> lost_at_end_{0};
};

/// Adds the mesh hash of one object to `before`, the combined hash of the objects before it. `before` is 0 for the
/// first object.
[[nodiscard]] constexpr std::uint64_t flight_hash(std::uint64_t before, std::uint64_t mesh_hash) noexcept {
  return before * 0x100000001b3u + mesh_hash;
}

}  // namespace tactus::hrtc_service
