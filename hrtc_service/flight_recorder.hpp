/// What a cycle is told and what it answers, kept for whoever wants to do it again.
///
///   CycleObserver: stop, reset, move, touch, refine --> [one record a cycle] --ring--> FlightStore: last seconds, file
///
/// A record holds the calls in their order as the structs of trace/flight_file.hpp, and now and then what the cycle
/// leaves to the next, so that a recording may begin there. It goes into the ring when the cycle has refined, as a
/// whole. When the ring is full the cycle is lost; which regions came and left is kept, and the next record that fits
/// says how many were lost and holds what is needed to go on. A cycle in which the ring of departures is full counts as
/// lost too: what then leaves depends on who empties it.
///
/// The haptic thread calls what is realtime, one other thread `next`.
#pragma once

#include <array>
#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <vector>

#include "hrtc_service/cycle.hpp"
#include "spm/forest.hpp"
#include "trace/flight_file.hpp"

namespace tactus::hrtc_service {

/// What an entry of a record holds.
enum class FlightEntry : std::uint32_t {
  kEvent,   ///< trace::FlightEvent
  kObject,  ///< the same, then a pointer to the TouchObject, of which only what never changes may be read
  kMove,    ///< trace::FlightMove
  kProbe,   ///< trace::FlightProbe
  kTouch,   ///< trace::FlightTouch
  kRefine,  ///< trace::FlightRefine
  kLost,    ///< how many cycles are, 64 bits; only events follow, and then kState
  kState    ///< see FlightRecorder::put_state
};

/// 64-bit words: how many words with this one, then entries: kind << 32 | words that follow, and these.
using FlightRecord = std::vector<std::uint64_t>;

class FlightRecorder final : public CycleObserver {
 public:
  static constexpr std::uint32_t kRingWords = 1u << 18;  ///< 2 MiB: 0.8 s of eight probes at 1 kHz
  static constexpr std::uint32_t kMaxInUse = 1u << 12;   ///< regions of an object; while more are, no state is told
  static constexpr std::uint32_t kMaxWords = 1u << 15;   ///< of a record; a longer one is lost
  /// Of the events that are kept while cycles are lost, some 4000; when there are more, recording ends.
  static constexpr std::uint32_t kMaxEventWords = 1u << 14;

  /// `state_every`: cycles from one state to the next. Allocates and touches everything, which is 2.5 MiB.
  explicit FlightRecorder(std::uint32_t state_every);

  void stopped(haptics::Fault fault) noexcept override;
  void reset() noexcept override;
  void moved(const TouchObject& object, const Placement& placement) noexcept override;
  void touched(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns, const Arrival* arrivals,
               std::uint32_t arrival_count, const CycleResult& result) noexcept override;
  /// Ends the record.
  void refined(Cycle& cycle, spm::Span<const Departure> left, bool departures_fit) noexcept override;

  /// The next record, if there is one. Allocates.
  [[nodiscard]] bool next(FlightRecord& record);
  /// It recorded nothing more since this many cycles had been lost with more events than are kept; 0: it records.
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
  std::vector<std::uint64_t> words_;   // of the record in the making; the first is for its size
  std::vector<std::uint64_t> events_;  // entries of what came and left in this cycle and those lost before it
  std::vector<spm::Forest::InUse> in_use_;
  std::uint32_t count_ = 1, event_count_ = 0;  // words
  std::uint32_t state_every_, since_state_ = 0;
  std::uint64_t cycle_ = 0, lost_ = 0;
  bool broken_ = false;  // the record does not fit
  std::atomic<std::uint64_t> ended_{0};
};

/// What is shown of one more object, mixed with that of the objects before; 0 for none.
[[nodiscard]] constexpr std::uint64_t flight_hash(std::uint64_t before, std::uint64_t mesh_hash) noexcept {
  return before * 0x100000001b3u + mesh_hash;
}

}  // namespace tactus::hrtc_service
