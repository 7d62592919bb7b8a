/// The servo is the half of an HRTC that computes forces, from device poses and from the objects that the gateway has
/// loaded.
///
///     1. touch     computes the forces
///     2. publish   simulates bodies and posts reports, after the devices have received the forces
///     3. refine    refines the meshes for the next touch, in the remaining time
///
/// Without a gateway, the force of a movable object on a hand decreases to zero within 60 ms, because peers and hosts
/// move such objects. The force of a fixed object stays for ServoSettings::gateway_patience and then decreases to zero.
/// Forces return when a gateway is in the session, so that it knows the standing stops. That of a movable object
/// returns when this gateway has also passed a pose of the object.
///
/// A cycle calls these three in this order. The class owns no thread, device, DDS endpoint or file, so the haptic
/// thread, studies in virtual time and benchmarks can all call it. A clock measures costs and may end refinement.
/// Realtime. One thread at a time.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "hrtc_service/servo/bodies.hpp"
#include "hrtc_service/servo/cycle.hpp"
#include "hrtc_service/servo/intake.hpp"
#include "hrtc_service/servo/servo_link.hpp"
#include "spm/ab_tree.hpp"

namespace tactus::hrtc_service {

struct ServoSettings {
  CycleSettings cycle;
  std::array<haptics::DeviceSpec, kMaxProbes> specs;  ///< limits of the probes' devices, world units
  CycleObserver* recorder = nullptr;                  ///< observer of every cycle; must outlive the servo
  std::uint32_t snapshot_nodes = 0;                   ///< max number of tree nodes in a snapshot; 0: no snapshots
  /// Number of local stops that a signal handler requests; must outlive the servo. Null: none.
  const std::atomic<std::uint32_t>* emergency_stop_signals = nullptr;
  double gateway_patience = 5;  ///< s, time for which fixed objects can be touched without the gateway
  /// False: the gateway is in the same process, so its silence shows only that the machine is busy, and changes no force.
  bool watches_gateway = true;
};

class Servo {
 public:
  using Inputs = std::array<ProbeInput, kMaxProbes>;
  using Outputs = std::array<ProbeOutput, kMaxProbes>;

  /// Allocates everything. The references must outlive the servo, and `log`, the ring for the queries of the contact
  /// log; null: none.
  Servo(const ServoSettings& settings, ServoLink& link, Intake& intake, BodyOrderLink& orders,
        ContactQuery::LogRing* log = nullptr);

  /// Computes the forces. Takes the objects near each probe from the link. The result is valid until the next touch.
  const Outputs& touch(const Inputs& inputs, std::int64_t now_ns) noexcept;
  /// Simulates bodies and posts reports. `next_due_ns`: planned start of the next cycle.
  void publish(std::int64_t now_ns, std::int64_t next_due_ns) noexcept;
  /// Refines within `budget` and `limit`, and returns the results of the whole cycle, with the forces before the ports
  /// of bodies limit them (`outputs` has the limited ones). Refines nothing while a snapshot is copied.
  const CycleResult& refine(spm::Budget budget, const RefineLimit& limit = {}) noexcept;

  [[nodiscard]] const Outputs& outputs() const noexcept { return outputs_; }
  [[nodiscard]] Cycle& cycle() noexcept { return cycle_; }
  [[nodiscard]] const Cycle& cycle() const noexcept { return cycle_; }

  /// Starts to copy the active meshes. Each of the next cycles copies a part. Returns false if the last copy is not
  /// complete or not released, or if the settings permit no snapshot.
  bool begin_snapshot() noexcept;
  /// Permits another snapshot. Call it after `snapshot`. Any thread, one at a time.
  void release_snapshot() noexcept { snapshots_released_.store(snapshots_done(), std::memory_order_release); }
  /// Returns the number of complete snapshots. Any thread.
  [[nodiscard]] std::uint32_t snapshots_done() const noexcept {
    return snapshots_done_.load(std::memory_order_acquire);
  }
  /// Returns an object's mesh in the last snapshot. Call it only between the end of a copy and its release. Allocates.
  [[nodiscard]] std::vector<SnapshotFace> snapshot(std::uint32_t object_index) const;

 private:
  [[nodiscard]] StopWord read_stop() noexcept;
  void obey(StopWord word) noexcept;
  void age_without_gateway(std::int64_t now_ns) noexcept;
  void continue_snapshot() noexcept;
  void report_shown(std::uint32_t object_index) noexcept;

  ServoLink& link_;
  MailboxReader<std::array<NearObjects, kMaxProbes>> near_objects_;
  MailboxWriter<ProbeReports> reports_;
  MailboxWriter<MeshHashes> mesh_hashes_;
  MailboxWriter<ShownReport> shown_reports_;
  ArrivalRing& arrivals_;
  Cycle cycle_;
  Bodies bodies_;
  StopWord stop_;
  bool stop_pressed_ = false;  // in the last cycle
  const std::atomic<std::uint32_t>* stop_signals_;
  std::uint32_t stop_signals_seen_ = 0, local_stops_ = 0;
  std::uint64_t cycles_ = 0;
  haptics::ForceSettings force_;
  double gateway_patience_;  // s
  bool watches_gateway_;
  std::uint64_t heartbeats_ = 0;         // of gateways in the session, newest
  std::uint32_t attach_requests_ = 0;    // of gateways, newest
  double silence_ = 0;                   // s, of the gateway, in cycles of this servo
  double unknown_silence_ = 0;           // s, the same, but it continues while the pose of a movable object is unknown
  std::uint64_t released_ = 0;           // movable objects, by index bit, whose forces are off without a gateway
  std::int64_t silence_updated_ns_ = 0;  // time of the last cycle
  Inputs inputs_;                        // of the last touch, with near objects and with ages without a gateway
  Outputs outputs_;                      // of the last touch, with forces limited by `bodies_`
  std::array<Arrival, 64> arrived_;
  MeshHashes hashes_{};
  ShownReport shown_;
  struct Snapshot {
    std::vector<spm::TreeNode> nodes;                  // leaves, object after object
    std::uint32_t count = 0;                           // leaves copied
    std::array<std::uint32_t, kMaxObjects> ends{};     // end in `nodes`, by position in Cycle::objects
    std::array<std::uint32_t, kMaxObjects> indices{};  // object index, by position in Cycle::objects
    std::uint32_t objects = 0;                         // objects copied completely
    std::uint32_t next_node = 0;                       // next leaf of the object that is being copied
    std::uint64_t objects_changed = 0;                 // Cycle::objects_changed at the start of the copy
    bool is_copying = false;
  } snapshot_;
  std::atomic<std::uint32_t> snapshots_done_{0}, snapshots_released_{0};
};

}  // namespace tactus::hrtc_service
