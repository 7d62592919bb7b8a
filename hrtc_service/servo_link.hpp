/// The interface between the two halves of an HRTC: rings of plain structs, newest-value mailboxes, one stop word.
///
///     gateway                                                 servo
///     objects and decoded regions      -- arrivals ------->   cycle
///     objects near each probe          -- near ----------->   cycle
///     who simulates each body, copies  -- bodies --------->   bodies
///     emergency stop and reset         -- stop word ------>   cycle
///     regions no longer applied        <- departures ------   cycle
///     probes, bodies, mesh hashes      <- mailboxes -------   after each cycle
///     audited queries                  <- log -------------   cycle
///
/// Every queue has one producer and one consumer. Nothing here blocks. Memory is allocated and touched at construction.
#pragma once

#include <array>
#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <memory>

#include "haptics/mailbox.hpp"
#include "hrtc_service/bodies.hpp"
#include "hrtc_service/cycle.hpp"
#include "hrtc_service/touch_object.hpp"

namespace tactus::hrtc_service {

/// The emergency stop for the servo, in one word, so that a stop and a reset cannot arrive in the wrong order.
struct StopWord {
  bool stopped = false;      ///< all forces are zero
  std::uint32_t resets = 0;  ///< below 2^31; an increase ends faults, and forces start softly unless `stopped`

  [[nodiscard]] std::uint32_t bits() const noexcept { return resets << 1 | (stopped ? 1u : 0u); }
  [[nodiscard]] static StopWord of(std::uint32_t bits) noexcept { return {(bits & 1u) != 0, bits >> 1}; }
};

/// The results of one cycle for the probes.
struct ProbeReports {
  std::int64_t time_ns = 0;
  std::int64_t next_due_ns = 0;  ///< planned start of the next cycle
  std::uint64_t cycle = 0;
  std::array<ProbeOutput, kMaxProbes> probes;
  std::array<std::uint32_t, haptics::kForceBits> interventions{};  ///< of CycleResult
};

/// Forest::mesh_hash of the mesh shown of each object, by object index; 0 where there is none.
using MeshHashes = std::array<std::uint64_t, kMaxObjects>;

/// Allocates a whole ring and touches its memory, so that the haptic thread causes no page fault there.
template <class Ring>
void touch_memory(Ring& ring) {
  const auto blank = std::make_unique<typename Ring::value_type>();
  while (ring.push(*blank)) {
  }
  ring.consume_all([](const auto&) {});
}

struct ServoLink {
  static constexpr std::size_t kRingEntries = 4096;

  /// `logs`: the servo records its queries.
  explicit ServoLink(bool logs = false)
      : arrivals{kRingEntries}, departures{kRingEntries}, log{logs ? kRingEntries : 1}, logs_queries{logs} {
    touch_memory(arrivals);
    touch_memory(departures);
    touch_memory(log);
  }

  // Gateway to servo.
  ArrivalRing arrivals;
  haptics::Mailbox<std::array<NearObjects, kMaxProbes>> near;
  /// The next cycle obeys it. Wait-free. One thread at a time calls this and `obeys_stop`.
  void set_stop(StopWord word) noexcept { stop_word_.store(word.bits(), std::memory_order_release); }
  [[nodiscard]] StopWord stop() const noexcept { return StopWord::of(stop_word_.load(std::memory_order_acquire)); }

  // Servo to gateway.
  DepartureRing departures;
  haptics::Mailbox<ProbeReports> reports_for_sender, reports_for_gateway;
  haptics::Mailbox<MeshHashes> mesh_hashes;
  Cycle::LogRing log;
  const bool logs_queries;
  void acknowledge_stop(StopWord word) noexcept { stop_obeyed_.store(word.bits(), std::memory_order_release); }
  /// Whether the published forces follow the newest `set_stop`.
  [[nodiscard]] bool obeys_stop() const noexcept {
    return stop_obeyed_.load(std::memory_order_acquire) == stop_word_.load(std::memory_order_relaxed);
  }

  // Both ways.
  BodyLink bodies;

 private:
  std::atomic<std::uint32_t> stop_word_{0}, stop_obeyed_{0};  // StopWord::bits
};

}  // namespace tactus::hrtc_service
