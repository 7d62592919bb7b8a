/// The half of an HRTC that makes forces: cycle, forest, proxies, bodies, safety.
///
///     touch     probe inputs, samples of the gateway  ->  forces
///     publish   moves the bodies, and reports             once the forces are out
///     refine    refines the mesh for the next touch       in the time that is left
///
/// A cycle is these three in this order. No thread, clock, device, DDS or file: the haptic thread of a service, a study
/// in virtual time and a benchmark drive the same class. Realtime. One thread.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "hrtc_service/bodies.hpp"
#include "hrtc_service/cycle.hpp"
#include "hrtc_service/servo_link.hpp"
#include "spm/ab_tree.hpp"

namespace tactus::hrtc_service {

/// A face of the mesh shown of one object; model frame, file units.
struct SnapshotFace {
  std::array<float, 9> corners;
  bool finest;
};

struct ServoSettings {
  CycleSettings cycle;
  std::array<haptics::DeviceSpec, kMaxProbes> specs;  ///< of the probes' devices, world units
  CycleObserver* recorder = nullptr;                  ///< of every cycle; outlives the servo
  std::uint32_t snapshot_nodes = 0;  ///< tree nodes of the pool when snapshots will be requested; 0: never
};

class Servo {
 public:
  using Inputs = std::array<ProbeInput, kMaxProbes>;
  using Outputs = std::array<ProbeOutput, kMaxProbes>;

  /// Allocates everything. `link` must outlive it.
  Servo(const ServoSettings& settings, ServoLink& link);

  /// Sets `inputs[i].near` from the link. The result stays valid until the next touch.
  const Outputs& touch(Inputs& inputs, std::int64_t now_ns) noexcept;
  /// `next_due_ns`: planned start of the next cycle.
  void publish(std::int64_t now_ns, std::int64_t next_due_ns) noexcept;
  /// The costs of the whole cycle so far. While a snapshot is copied it refines nothing.
  const CycleResult& refine(spm::Budget budget, const RefineLimit& limit = {}) noexcept;

  [[nodiscard]] const Outputs& outputs() const noexcept { return outputs_; }
  [[nodiscard]] Cycle& cycle() noexcept { return cycle_; }
  [[nodiscard]] const Cycle& cycle() const noexcept { return cycle_; }

  /// Starts to copy the shown meshes, a part in each of several cycles.
  void begin_snapshot() noexcept;
  /// Snapshots copied so far. Any thread.
  [[nodiscard]] std::uint32_t snapshots_done() const noexcept {
    return snapshots_done_.load(std::memory_order_acquire);
  }
  /// The mesh shown of an object in the last snapshot; only between `snapshots_done` and the next request. Allocates.
  [[nodiscard]] std::vector<SnapshotFace> snapshot(std::uint32_t object_index) const;

 private:
  void obey(StopWord word) noexcept;
  void continue_snapshot() noexcept;

  ServoLink& link_;
  Cycle cycle_;
  Bodies bodies_;
  StopWord stop_;
  std::uint64_t cycles_ = 0;
  Outputs outputs_;  // of the touch, with what bodies change of it
  std::array<Arrival, 64> arrived_;
  MeshHashes hashes_{};
  struct Snapshot {
    std::vector<spm::TreeNode> nodes;  // of level 1, object after object
    std::uint32_t count = 0;
    std::array<std::uint32_t, kMaxObjects> ends{};  // in `nodes`, by position among the cycle's objects
    std::array<std::uint32_t, kMaxObjects> indices{};
    std::uint32_t objects = 0;          // copied whole
    std::uint32_t next_node = 0;        // of the object after these
    std::uint64_t objects_changed = 0;  // of the cycle, when it began
    bool under_way = false;
  } snapshot_;
  std::atomic<std::uint32_t> snapshots_done_{0};
};

}  // namespace tactus::hrtc_service
