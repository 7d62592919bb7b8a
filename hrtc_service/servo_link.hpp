/// Connects the two halves of an HRTC, gateway and servo, by rings, mailboxes and one stop word.
///
///     gateway                                                  servo
///     objects and decoded regions       -- intake --------->   Intake --> Cycle
///     answers, free memory              <- intake ----------   Intake
///     objects near each probe           -- near ----------->   Cycle
///     poses of users at clients         -- devices -------->   ProbeDevices
///     grants of bodies                  -- bodies --------->   BodyIntake --> Bodies
///     samples of peers' copies          -- bodies --------->   Bodies
///     emergency stop and reset          -- stop word ------>   Cycle
///     local stops, by button or signal  <- counter ---------   obeyed before the gateway knows of them
///     object whose regions a viewer needs -- request ------>   Servo
///     probes, bodies, mesh hashes       <- mailboxes -------   after each cycle
///
/// The queries for the contact log have a ring of their own (ContactQuery::LogRing).
///
/// Plain values only, no pointer: two processes can share it. The servo checks all that it reads here. Nothing blocks.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

#include "hrtc_service/bodies.hpp"
#include "hrtc_service/device_link.hpp"
#include "hrtc_service/intake_link.hpp"
#include "hrtc_service/shared_mailbox.hpp"
#include "hrtc_service/touch_object.hpp"
#include "session/messages.hpp"

namespace tactus::hrtc_service {

/// Stop and reset for the servo in one word, so that they cannot arrive in the wrong order.
struct StopWord {
  bool stopped = false;      ///< all forces are zero
  std::uint32_t resets = 0;  ///< number of resets, below 2^31; an increase ends faults

  [[nodiscard]] std::uint32_t bits() const noexcept { return resets << 1 | (stopped ? 1u : 0u); }
  [[nodiscard]] static StopWord from_bits(std::uint32_t bits) noexcept { return {(bits & 1u) != 0, bits >> 1}; }
};

/// The results of one cycle for the probes.
struct ProbeReports {
  std::int64_t time_ns = 0;
  std::int64_t next_due_ns = 0;  ///< planned start of the next cycle
  std::uint64_t cycle = 0;
  std::array<ProbeOutput, kMaxProbes> probes;
  std::array<std::uint32_t, haptics::kForceBits> interventions{};  ///< as in CycleResult
};

/// Forest::mesh_hash of each object's active mesh, by object index; 0 where there is no object.
using MeshHashes = std::array<std::uint64_t, kMaxObjects>;

/// The regions that determine the active mesh of an object, in one cycle.
struct ShownReport {
  std::uint32_t object = spm::kNone;  ///< index
  std::uint64_t mesh_hash = 0;
  std::uint32_t count = 0;  ///< number of regions; if it is larger than that of `regions`, the others are missing
  std::array<spm::Forest::InUse, session::kMaxShownRegions> regions;
};

struct ServoLink {
  // Gateway to servo.
  DeviceLink devices;
  SharedMailbox<std::array<NearObjects, kMaxProbes>> near_objects;
  /// Sets the stop word for the next cycle. Wait-free. One thread at a time calls this and `obeys_stop`.
  void set_stop(StopWord word) noexcept { stop_word_.store(word.bits(), std::memory_order_release); }
  [[nodiscard]] StopWord stop() const noexcept {
    return StopWord::from_bits(stop_word_.load(std::memory_order_acquire));
  }
  /// Sets the number of local stops for which the gateway has set the stop word. Call it after `set_stop`.
  void set_local_stops_issued(std::uint32_t count) noexcept {
    local_stops_issued_.store(count, std::memory_order_release);
  }
  [[nodiscard]] std::uint32_t local_stops_issued() const noexcept {
    return local_stops_issued_.load(std::memory_order_acquire);
  }
  /// Requests that the servo reports the regions of an object's mesh. A new request replaces one that is not answered.
  void request_shown(std::uint32_t object_index) noexcept {
    shown_request_.store(object_index, std::memory_order_relaxed);
  }
  /// Returns the index of the object whose regions are requested, or kNone, and ends the request.
  [[nodiscard]] std::uint32_t take_shown_request() noexcept {
    if (shown_request_.load(std::memory_order_relaxed) == spm::kNone) return spm::kNone;
    return shown_request_.exchange(spm::kNone, std::memory_order_relaxed);
  }

  // Servo to gateway.
  SharedMailbox<ProbeReports> reports;
  SharedMailbox<MeshHashes> mesh_hashes;
  SharedMailbox<ShownReport> shown_reports;
  void acknowledge_stop(StopWord word) noexcept { stop_obeyed_.store(word.bits(), std::memory_order_release); }
  /// Returns whether the published forces obey the newest stop word.
  [[nodiscard]] bool obeys_stop() const noexcept {
    return stop_obeyed_.load(std::memory_order_acquire) == stop_word_.load(std::memory_order_relaxed);
  }
  /// Number of local stops, by button or signal: emergency stops that are requested at this HRTC. The servo obeys one in
  /// its next cycle. Then the gateway issues a stop, which a reset can name.
  void set_local_stops(std::uint32_t count) noexcept { local_stops_.store(count, std::memory_order_relaxed); }
  [[nodiscard]] std::uint32_t local_stops() const noexcept { return local_stops_.load(std::memory_order_relaxed); }

  // In both directions.
  IntakeLink intake;
  BodyLink bodies;

 private:
  std::atomic<std::uint32_t> stop_word_{0}, stop_obeyed_{0};  // StopWord::bits
  std::atomic<std::uint32_t> local_stops_{0}, local_stops_issued_{0};
  std::atomic<std::uint32_t> shown_request_{spm::kNone};
};

}  // namespace tactus::hrtc_service
