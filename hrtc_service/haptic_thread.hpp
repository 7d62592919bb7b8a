/// The thread in which forces are made: devices, cycle, budget, deadline.
///
///   commands, objects near, arrivals  -->  read devices -> Cycle::touch -> write forces -> Cycle::refine  --> reports,
///   orders for bodies                        Bodies::place       Bodies::limit   Bodies::step     departures, traces,
///   log
///
/// Its loop allocates, locks and logs nothing, and its only system call is the sleep. docs/cycle.md follows one pose
/// through it.
#pragma once

#include <algorithm>
#include <atomic>
#include <boost/lockfree/spsc_queue.hpp>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "haptics/device.hpp"
#include "haptics/mailbox.hpp"
#include "hrtc_service/bodies.hpp"
#include "hrtc_service/cycle.hpp"
#include "hrtc_service/governor.hpp"
#include "hrtc_service/late_cycles.hpp"

namespace tactus::hrtc_service {

/// What a probe slot is to do. Devices belong to the service, which keeps them until commands without them are obeyed.
struct HapticCommands {
  std::uint64_t number = 0;                            ///< grows with each
  std::array<haptics::Device*, kMaxProbes> devices{};  ///< null: no probe
  std::array<bool, kMaxProbes> framed{};               ///< the device has a frame of its own
  std::uint32_t snapshots = 0;                         ///< grows: copy the shown mesh
};

/// The emergency stop as the haptic thread obeys it, in one word, so that a stop and a reset cannot change places.
struct StopWord {
  bool stopped = false;      ///< all forces are zero
  std::uint32_t resets = 0;  ///< below 2^31; grows: end faults, forces start softly unless `stopped`

  [[nodiscard]] std::uint32_t bits() const noexcept { return resets << 1 | (stopped ? 1u : 0u); }
  [[nodiscard]] static StopWord of(std::uint32_t bits) noexcept { return {(bits & 1u) != 0, bits >> 1}; }
};

struct ProbeReports {
  std::int64_t time_ns = 0;
  std::int64_t next_due_ns = 0;  ///< when the next cycle is to begin
  std::uint64_t cycle = 0;
  std::array<ProbeOutput, kMaxProbes> probes;
  std::array<std::uint32_t, haptics::kForceBits> interventions{};  ///< of CycleResult
};

/// Of the pose that a report is of, as messages tell it.
[[nodiscard]] inline std::uint32_t age_us(const ProbeOutput& probe) noexcept {
  return static_cast<std::uint32_t>(std::clamp(probe.pose_age * 1e6f, 0.0f, 4e9f));
}

/// Forest::mesh_hash of the mesh shown of each object, by object index; 0 where there is none.
using MeshHashes = std::array<std::uint64_t, kMaxObjects>;

/// One cycle in numbers; ns.
struct CycleTrace {
  CycleCosts costs;
  CycleTimes times;
  std::uint32_t wake_late = 0;  ///< after its due time
  std::uint32_t skipped = 0;    ///< ticks missed altogether before it
  std::uint8_t active = 0;      ///< probes
  std::uint8_t in_contact = 0;
  std::uint8_t exact = 0;  ///< of those in contact
  std::uint8_t stale = 0;  ///< probes whose pose was too old
  bool targets_dropped = false;
};

/// A face of the mesh shown of one object; model frame, file units.
struct SnapshotFace {
  std::array<float, 9> corners;
  bool last;
};

struct HapticSettings {
  CycleSettings cycle;                 ///< also says the period
  std::int64_t deadline_ns = 250'000;  ///< for the cycle's own work
  int priority = 60;                   ///< SCHED_FIFO; 0: do not ask
  haptics::DeviceFrame frame;          ///< of devices that have one of their own
  bool log = false;
  CycleObserver* recorder = nullptr;  ///< of every cycle; outlives the thread
  std::uint32_t snapshot_nodes = 0;   ///< tree nodes of the pool when snapshots will be asked for; 0: never

  [[nodiscard]] std::int64_t period_ns() const noexcept { return std::llround(cycle.period * 1e9); }
};

class HapticThread {
 public:
  using TraceRing = boost::lockfree::spsc_queue<CycleTrace>;

  /// Allocates everything; `specs` in world units.
  HapticThread(const HapticSettings& settings, const std::array<haptics::DeviceSpec, kMaxProbes>& specs);
  ~HapticThread();

  /// Starts; returns the line that says what the system granted.
  [[nodiscard]] std::string start();
  void stop();

  [[nodiscard]] haptics::Mailbox<HapticCommands>& commands() noexcept { return commands_; }
  /// The next cycle that begins obeys it. Wait-free. One thread at a time calls this and `obeys_stop`.
  void set_stop(StopWord word) noexcept { stop_word_.store(word.bits(), std::memory_order_release); }
  /// The forces that are out follow the newest `set_stop`.
  [[nodiscard]] bool obeys_stop() const noexcept {
    return stop_obeyed_.load(std::memory_order_acquire) == stop_word_.load(std::memory_order_relaxed);
  }
  /// Whether commands of this number or later ones are obeyed: a device that they no longer name is not used any more.
  [[nodiscard]] bool has_obeyed(std::uint64_t number) const noexcept {
    return obeyed_.load(std::memory_order_acquire) >= number;
  }
  [[nodiscard]] haptics::Mailbox<std::array<NearObjects, kMaxProbes>>& near() noexcept { return near_; }
  [[nodiscard]] ArrivalRing& arrivals() noexcept { return arrivals_; }
  [[nodiscard]] DepartureRing& departures() noexcept { return departures_; }
  [[nodiscard]] haptics::Mailbox<ProbeReports>& reports_for_sender() noexcept { return sender_reports_; }
  [[nodiscard]] haptics::Mailbox<ProbeReports>& reports_for_service() noexcept { return service_reports_; }
  [[nodiscard]] haptics::Mailbox<MeshHashes>& mesh_hashes() noexcept { return mesh_hashes_; }
  /// What can move: its mailboxes and its ring.
  [[nodiscard]] Bodies& bodies() noexcept { return bodies_; }
  [[nodiscard]] TraceRing& traces() noexcept { return traces_; }
  [[nodiscard]] Cycle::LogRing& log() noexcept { return log_; }
  /// Reads what the system counts for the thread; after `start`.
  [[nodiscard]] UsageSampler& usage() noexcept { return *usage_; }
  [[nodiscard]] std::uint64_t traces_dropped() const noexcept {
    return traces_dropped_.load(std::memory_order_relaxed);
  }
  /// Log entries that found the ring full. Only after `stop`.
  [[nodiscard]] std::uint64_t log_dropped() const noexcept { return cycle_.log_dropped(); }

  /// Grows when what was asked for by HapticCommands::snapshots has been copied, a part in each of several cycles in
  /// which nothing is refined.
  [[nodiscard]] std::uint32_t snapshots_done() const noexcept {
    return snapshots_done_.load(std::memory_order_acquire);
  }
  /// The mesh shown of an object in the last snapshot; only between `snapshots_done` and the next request. Allocates.
  [[nodiscard]] std::vector<SnapshotFace> snapshot(std::uint32_t object_index) const;

 private:
  void run();
  void obey(const HapticCommands& commands) noexcept;
  void obey(StopWord word) noexcept;
  void read_devices(std::int64_t now_ns) noexcept;
  void write_forces() noexcept;
  void continue_snapshot() noexcept;

  HapticSettings settings_;
  haptics::Mailbox<HapticCommands> commands_;
  std::atomic<std::uint32_t> stop_word_{0}, stop_obeyed_{0};  // StopWord::bits
  haptics::Mailbox<std::array<NearObjects, kMaxProbes>> near_;
  haptics::Mailbox<ProbeReports> sender_reports_, service_reports_;
  haptics::Mailbox<MeshHashes> mesh_hashes_;
  ArrivalRing arrivals_;
  DepartureRing departures_;
  TraceRing traces_;
  Cycle::LogRing log_;
  Cycle cycle_;
  Bodies bodies_;
  Governor governor_;
  std::thread thread_;
  std::unique_ptr<UsageSampler> usage_;
  std::atomic<bool> running_{false};
  std::atomic<std::uint64_t> traces_dropped_{0};
  std::atomic<std::uint32_t> snapshots_done_{0};
  std::atomic<std::uint64_t> obeyed_{0};  // number of the newest commands
  struct Snapshot {
    std::vector<spm::TreeNode> nodes;  // of level 1, object after object
    std::uint32_t count = 0;
    std::array<std::uint32_t, kMaxObjects> endpoints{};  // in `nodes`, by place among the cycle's objects
    std::array<std::uint32_t, kMaxObjects> indices{};
    std::uint32_t objects = 0;    // copied whole
    std::uint32_t next_node = 0;  // of the object after these
    bool under_way = false;
  } snapshot_;

  // The thread's own.
  HapticCommands current_;
  StopWord stop_;
  std::array<haptics::DeviceFrame, kMaxProbes> frames_;
  std::array<ProbeInput, kMaxProbes> inputs_;
  std::array<ProbeOutput, kMaxProbes> outputs_;  // of the touch, with what bodies change of it
  std::array<Arrival, 64> arrived_;
  MeshHashes hashes_{};
};

/// What a haptic thread is told: all of it again with each change. One thread.
class HapticOrders {
 public:
  explicit HapticOrders(HapticThread& to) : to_{to} {}

  template <class Change>
  void tell(Change&& change) {
    change(commands_);
    ++commands_.number;
    to_.commands().post(commands_);
  }
  /// Whether the thread obeys what was told last when `now().number` was this.
  [[nodiscard]] bool obeyed(std::uint64_t number) const noexcept { return to_.has_obeyed(number); }
  [[nodiscard]] const HapticCommands& now() const noexcept { return commands_; }

 private:
  HapticThread& to_;
  HapticCommands commands_;
};

}  // namespace tactus::hrtc_service
