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
///     object index for a viewer         -- request -------->   Servo
///     probes, bodies, mesh hashes       <- mailboxes -------   after each cycle
///     traces of cycles, thread usage    <- rings -----------   after each cycle, and every 4 ms
///     recordings and snapshots wanted   -- requests ------->   ServoRunner
///     exit status of an HRTC that ends  -- word ----------->   supervisor, which ends the servo
///     whether the servo has ended       <- flag ------------   supervisor
///     faces of a snapshot               <- ring ------------   ServoRunner
///
/// The queries for the contact log have a ring of their own (ContactQuery::LogRing).
///
/// Plain values only, no pointer: two processes can share it. The servo checks all that it reads here. Nothing blocks.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>

#include "hrtc_service/servo/bodies.hpp"
#include "hrtc_service/servo/device_link.hpp"
#include "hrtc_service/servo/intake_link.hpp"
#include "hrtc_service/servo/late_cycles.hpp"
#include "hrtc_service/servo/shared_mailbox.hpp"
#include "hrtc_service/servo/shared_ring.hpp"
#include "hrtc_service/servo/touch_object.hpp"
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

/// A face of an object's active mesh, model frame, file units.
struct SnapshotFace {
  std::array<float, 9> corners;
  bool finest;
};

/// A part of a copy of the active meshes.
struct SnapshotPart {
  std::uint32_t object = spm::kNone;  ///< index of the object; kNone: the copy is complete
  SnapshotFace face{};
};

/// Requests a flight recording, as FlightSaver::save.
struct FlightRequest {
  std::array<char, 128> reason{};  ///< ends with a zero byte
};

/// Measurements of one cycle.
struct CycleTrace {
  CycleCosts costs;
  CycleTimes times;
  std::uint32_t wake_late = 0;  ///< wake-up time minus due time, ns
  std::uint32_t skipped = 0;    ///< periods skipped before this cycle
  std::uint8_t active = 0;      ///< active probes
  std::uint8_t in_contact = 0;  ///< probes in contact
  std::uint8_t exact = 0;       ///< probes in exact contact
  std::uint8_t stale = 0;       ///< probes with a stale pose
  bool targets_dropped = false;
};

struct ServoLink {
  static constexpr std::uint32_t kTraces = 8192, kUsages = 1024, kFlightRequests = 16, kSnapshotParts = 4096;

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
  /// Increments the heartbeat counter of the gateway, and that of the session if it is in the session. Call it at least
  /// every 10 ms. Any thread.
  void beat() noexcept {
    heartbeats_.fetch_add(1, std::memory_order_relaxed);
    if (in_session_.load(std::memory_order_acquire)) session_heartbeats_.fetch_add(1, std::memory_order_release);
  }
  /// Heartbeats of all gateways: they show that a gateway runs.
  [[nodiscard]] std::uint64_t heartbeats() const noexcept { return heartbeats_.load(std::memory_order_relaxed); }
  /// Heartbeats of gateways in the session: they permit forces. Read them before `stop` and the attach requests, which
  /// are then at least as new.
  [[nodiscard]] std::uint64_t session_heartbeats() const noexcept {
    return session_heartbeats_.load(std::memory_order_acquire);
  }
  /// Sets whether the gateway is in the session: it has received the roster entry of a host. Such an entry lists the
  /// standing stops, so call `set_stop` first. A gateway begins outside the session.
  void set_in_session(bool in_session) noexcept { in_session_.store(in_session, std::memory_order_release); }
  /// Stores the status bits of a probe's fault that the gateway has logged, 0: none. Returns those before. The next
  /// gateway logs only faults that no gateway has logged.
  std::uint32_t exchange_fault_logged(std::uint32_t probe, std::uint32_t bits) noexcept {
    return faults_logged_[probe].exchange(bits, std::memory_order_relaxed);
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

  /// Declares that the gateway ends the HRTC with this exit status, 0 to 255. The servo ends its threads then.
  void end(int status) noexcept { ended_.store(static_cast<std::uint32_t>(status) + 1, std::memory_order_release); }
  /// Returns the declared exit status, or -1.
  [[nodiscard]] int ended() const noexcept {
    return static_cast<int>(std::min(ended_.load(std::memory_order_acquire), 256u)) - 1;
  }

  SharedRing<FlightRequest, kFlightRequests> flight_requests;
  /// Requests a copy of the active meshes, which arrives in `snapshot_parts`. One thread, not before the last copy has
  /// arrived.
  void request_snapshot() noexcept { snapshot_requests_.fetch_add(1, std::memory_order_relaxed); }
  [[nodiscard]] std::uint32_t snapshot_requests() const noexcept {
    return snapshot_requests_.load(std::memory_order_relaxed);
  }

  // Servo to gateway.
  SharedMailbox<ProbeReports> reports;
  SharedMailbox<MeshHashes> mesh_hashes;
  SharedMailbox<ShownReport> shown_reports;
  SharedRing<CycleTrace, kTraces> traces;   ///< of each cycle
  SharedRing<ThreadUsage, kUsages> usages;  ///< of the haptic thread
  SharedRing<SnapshotPart, kSnapshotParts> snapshot_parts;
  void count_dropped_trace() noexcept { traces_dropped_.fetch_add(1, std::memory_order_relaxed); }
  /// Number of traces that were lost because the ring was full.
  [[nodiscard]] std::uint64_t traces_dropped() const noexcept {
    return traces_dropped_.load(std::memory_order_relaxed);
  }
  void set_log_dropped(std::uint64_t count) noexcept { log_dropped_.store(count, std::memory_order_relaxed); }
  /// Number of logged queries that were lost because the ring was full.
  [[nodiscard]] std::uint64_t log_dropped() const noexcept { return log_dropped_.load(std::memory_order_relaxed); }
  void acknowledge_stop(StopWord word) noexcept { stop_obeyed_.store(word.bits(), std::memory_order_release); }
  /// Returns whether the published forces obey the newest stop word.
  [[nodiscard]] bool obeys_stop() const noexcept {
    return stop_obeyed_.load(std::memory_order_acquire) == stop_word_.load(std::memory_order_relaxed);
  }
  /// Declares that the threads of the servo have ended, so that nothing in the link changes any more.
  void set_servo_ended() noexcept { servo_ended_.store(true, std::memory_order_release); }
  [[nodiscard]] bool has_servo_ended() const noexcept { return servo_ended_.load(std::memory_order_acquire); }
  /// Number of local stops, by button or signal: emergency stops that are requested at this HRTC. The servo obeys one
  /// in its next cycle. Then the gateway issues a stop, which a reset can name.
  void set_local_stops(std::uint32_t count) noexcept { local_stops_.store(count, std::memory_order_relaxed); }
  [[nodiscard]] std::uint32_t local_stops() const noexcept { return local_stops_.load(std::memory_order_relaxed); }

  // In both directions.
  IntakeLink intake;
  BodyLink bodies;

 private:
  std::atomic<std::uint32_t> stop_word_{0}, stop_obeyed_{0};  // StopWord::bits
  std::atomic<std::uint32_t> local_stops_{0}, local_stops_issued_{0};
  std::atomic<std::uint32_t> shown_request_{spm::kNone};
  std::atomic<std::uint64_t> heartbeats_{0}, session_heartbeats_{0}, traces_dropped_{0}, log_dropped_{0};
  std::atomic<bool> in_session_{false};
  std::array<std::atomic<std::uint32_t>, kMaxProbes> faults_logged_{};  // status bits
  std::atomic<std::uint32_t> snapshot_requests_{0};
  std::atomic<std::uint32_t> ended_{0};  // exit status + 1; 0: not ended
  std::atomic<bool> servo_ended_{false};
};

}  // namespace tactus::hrtc_service
