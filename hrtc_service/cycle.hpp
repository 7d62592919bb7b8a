/// One haptic step: from the newest device positions to forces, and the mesh refined towards where they go.
///
///   arrivals -> refine within the budget -> refit -> query -> proxy -> force
///      T_L            T_R                    T_B      T_Q      T_F
///
/// `step` is a function of its arguments and of what earlier steps left: it reads no clock but to time itself, so
/// inputs and budgets can be recorded and replayed to the bit. Realtime. The haptic thread's.
#pragma once

#include <array>
#include <boost/lockfree/spsc_queue.hpp>
#include <cstdint>
#include <vector>

#include "haptics/force.hpp"
#include "haptics/proxy.hpp"
#include "hrtc_service/touch_object.hpp"
#include "trace/contact_log.hpp"

namespace tactus::hrtc_service {

struct CycleSettings {
  double period = 0.001;  ///< s
  double radius = 0.003;  ///< m, of every tip
  /// m; cells this near to a tip are refined although not met, so that they are ready when they are.
  double refine_margin = 0.0005;
  /// m; cells refined stay so until the tip is this far: a tip that wavers does not split and collapse in turn.
  double keep_margin = 0.002;
  /// s; the tip's motion this far ahead is refined for.
  double refine_ahead = 0.01;
  haptics::ForceSettings force;
};

struct ProbeInput {
  bool active = false;
  haptics::DeviceState device;  ///< tip, world
  double pose_age = 0;          ///< s
  NearObjects near;             ///< from the broad phase
};

struct ProbeOutput {
  bool active = false;
  Plain3 device{};  ///< tip, world
  Plain3 velocity{};
  Plain3 proxy{};
  Plain3 force{};                     ///< on the hand, world
  std::uint32_t object = spm::kNone;  ///< index of the one touched
  std::uint32_t status = 0;           ///< session::StatusBit
  std::uint32_t contacts = 0;
  float error_bound = 0;  ///< m; the greatest of all numbers while an object near it is not shown yet
  float pose_age = 0;     ///< s
};

/// Times in ns, counts of this cycle.
struct CycleCosts {
  std::uint32_t load = 0, refine = 0, refit = 0, query = 0, force = 0;
  std::uint32_t arrivals = 0, visits = 0, changes = 0, nodes_marked = 0;
  [[nodiscard]] std::uint32_t total() const noexcept { return load + refine + refit + query + force; }
};

struct CycleResult {
  std::array<ProbeOutput, kMaxProbes> probes;
  CycleCosts costs;
  bool budget_spent = false;
  bool nodes_full = false;
};

class Cycle {
 public:
  using LogRing = boost::lockfree::spsc_queue<trace::LoggedQuery>;

  /// `departures` and, when not null, `log` must outlive the cycle. Not realtime.
  /// `specs`: what each probe's device bears, in world units.
  Cycle(const CycleSettings& settings, const std::array<haptics::DeviceSpec, kMaxProbes>& specs,
        DepartureRing& departures, LogRing* log);

  /// `now_ns` only dates the log. The result stays valid until the next step.
  const CycleResult& step(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns,
                          const Arrival* arrivals, std::uint32_t arrival_count, spm::Budget budget) noexcept;

  /// Zero force on every probe until reset_faults. Realtime.
  void stop(haptics::Fault fault) noexcept;
  /// Ends the faults; forces start softly again.
  void reset_faults() noexcept;

  [[nodiscard]] const std::vector<TouchObject*>& objects() const noexcept { return objects_; }
  /// Log entries that found the ring full.
  [[nodiscard]] std::uint64_t log_dropped() const noexcept { return log_dropped_; }

 private:
  static constexpr std::uint32_t kMaxTargets = 256;
  static constexpr std::uint32_t kMaxContacts = 2048;
  struct Target {
    spm::RegionId region;
    double key;  // smaller first
  };
  [[nodiscard]] bool is_near(std::uint32_t probe, const TouchObject& object) const noexcept {
    return (near_[probe] >> object.index & 1u) != 0;
  }

  struct ObjectState {
    std::uint32_t since_change = 0;
    bool changed = false;
  };

  void take(const Arrival& arrival) noexcept;
  void add_target(spm::RegionId region, double key) noexcept;
  void choose_targets(TouchObject& object, const std::array<ProbeInput, kMaxProbes>& probes) noexcept;
  void query(std::uint32_t probe, const ProbeInput& input, std::int64_t now_ns, ProbeOutput& output) noexcept;
  void render(std::uint32_t probe, const ProbeInput& input, ProbeOutput& output) noexcept;
  void log(const TouchObject& object, std::uint32_t probe, std::int64_t now_ns, const Vec3d& centre, double radius,
           bool exact, std::uint32_t found, bool truncated) noexcept;

  CycleSettings settings_;
  DepartureRing& departures_;
  LogRing* log_;
  std::vector<TouchObject*> objects_;              // reserved for kMaxObjects
  std::array<ObjectState, kMaxObjects> states_{};  // by object index
  std::array<std::uint64_t, kMaxProbes> near_{};   // objects that a tip could touch, by index bit
  std::array<haptics::Proxy, kMaxProbes> proxies_;
  double reach_ = haptics::ProxySettings{}.reach;  // m, of the proxies; grows with the objects
  std::vector<haptics::ForceRenderer> forces_;     // by probe
  std::array<ObjectsSurface, kMaxProbes> surfaces_;
  std::array<Target, kMaxTargets> targets_;
  std::uint32_t target_count_ = 0;
  std::array<spm::RegionId, kMaxTargets> target_regions_;
  std::array<spm::Contact, kMaxContacts> contacts_;
  trace::LoggedQuery entry_;
  std::uint64_t log_dropped_ = 0;
  CycleResult result_;
};

}  // namespace tactus::hrtc_service
