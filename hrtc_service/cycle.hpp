/// One haptic cycle: computes forces from the newest device positions, and refines the mesh where the tips will be.
///
///   arrivals -> query -> proxy -> force  |  select -> refine within the limit -> refit
///      T_L       T_Q          T_F        |              T_R                        T_B
///   touch -------------------------------|- refine ----------------------------------
///
/// A hand whose grab button is down holds the movable object that it touches. From the next touch until the button is
/// up, the hand is coupled to the contact point and the orientation of the object, and not to its surface.
///
/// An object that is withdrawn is not touched any more, and its forces on hands decrease to zero. A share of each
/// cycle's budget removes its mesh. When nothing is left, the object departs, and its index can be used again.
///
/// `touch` and `refine` are functions of their arguments and of the calls before. The exception is the clock that may
/// stop refinement. `refine` reports how much work was granted until then; with that as its budget and without a clock
/// the results are the same to the bit. So inputs and grants can be recorded and replayed (flight_recorder.hpp).
/// Realtime. The haptic thread's.
///
/// We differ from the paper's order (refine, then query). Forces are published sooner, and their cost is known when the
/// time for refinement is limited. A refined mesh is touched one cycle later, so refinement predicts the tip's position
/// by one cycle.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "haptics/carried.hpp"
#include "haptics/force.hpp"
#include "hrtc_service/contact_query.hpp"
#include "hrtc_service/governor.hpp"
#include "hrtc_service/held_object.hpp"
#include "hrtc_service/probe.hpp"
#include "hrtc_service/sphere_touch.hpp"
#include "hrtc_service/tool_touch.hpp"
#include "hrtc_service/touch_object.hpp"
#include "spm/target_selection.hpp"

namespace tactus::hrtc_service {

struct CycleSettings {
  static constexpr std::uint32_t kMaxTargets = 1u << 16;

  double period = 0.001;  ///< s
  double radius = 0.003;  ///< m, of every tip
  /// The tool that every probe holds instead of a sphere, m; outlives the cycle. Null: a sphere.
  const spm::MeshProbe* tool = nullptr;
  /// m; cells this near to a tip are refined before the tip meets them.
  double refine_margin = 0.0005;
  /// m; cells stay refined until the tip is this far away, so that a trembling tip does not split and collapse them.
  double keep_margin = 0.002;
  /// s; refinement covers the tip's predicted motion for this long.
  double refine_ahead = 0.01;
  /// Regions of an object that are refined at a time, 1 to kMaxTargets. Exceeded: the least urgent stay coarse, with
  /// session::kTargetsDropped.
  std::uint32_t targets = 1024;
  haptics::ForceSettings force;
};

/// Times in ns, and counts, of this cycle.
struct CycleCosts {
  std::uint32_t load = 0, refine = 0, refit = 0, query = 0, force = 0;
  std::uint32_t arrivals = 0, visits = 0, changes = 0, nodes_marked = 0;
  std::uint32_t granted = 0;   ///< units of Budget, in portions; a replay takes them as its budget
  std::uint32_t foreseen = 0;  ///< predicted time of the whole cycle when the last portion began; 0: no portion
  [[nodiscard]] std::uint32_t total() const noexcept { return load + refine + refit + query + force; }
};

struct CycleResult {
  std::array<ProbeOutput, kMaxProbes> probes;
  CycleCosts costs;
  /// How often each haptics::ForceBit began to act, since the start, summed over all probes.
  std::array<std::uint32_t, haptics::kForceBits> interventions{};
  bool budget_spent = false;
  bool nodes_full = false;
  bool targets_dropped = false;  ///< more regions were wanted than CycleSettings::targets
};

class Cycle;

/// Observes in order every call of a cycle that can change later results, with its result. Realtime.
class CycleObserver {
 public:
  virtual ~CycleObserver() = default;
  virtual void stopped(haptics::Fault fault) noexcept = 0;
  virtual void reset() noexcept = 0;
  virtual void moved(const TouchObject& object, const Placement& placement) noexcept = 0;
  virtual void touched(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns, const Arrival* arrivals,
                       std::uint32_t arrival_count, const CycleResult& result) noexcept = 0;
  /// `left`: the regions returned to the loader. `departures_fit`: the ring of departures is not full.
  virtual void refined(Cycle& cycle, std::span<const Departure> left, bool departures_fit) noexcept = 0;
};

class Cycle {
 public:
  using LogRing = ContactQuery::LogRing;

  /// `departures` and, when not null, `log` must outlive the cycle. Not realtime.
  /// `specs`: the limits of each probe's device, in world units.
  Cycle(const CycleSettings& settings, const std::array<haptics::DeviceSpec, kMaxProbes>& specs,
        DepartureRing& departures, LogRing* log);

  /// Must outlive the cycle. Not realtime.
  void set_observer(CycleObserver* observer) noexcept { observer_ = observer; }
  /// Makes each tool search its surroundings again, as after `for_each_carried`. Realtime.
  void forget_surroundings() noexcept {
    for (ToolTouch& tool : tools_) tool.tool().forget_surroundings();
  }
  /// Visits all state that one cycle passes to the next, except the meshes; see haptics/carried.hpp. A cycle of the
  /// same build, settings and objects continues from it with the same results. State that only came from outside may
  /// have any value. Realtime if `visit` is.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    static_assert(sizeof(ObjectState) == 544 && sizeof(ProbeOutput) == 216 && sizeof(CycleCosts) == 44,
                  "carry the new member");
    for (const TouchObject* object : objects_) {
      ObjectState& state = states_[object->index];
      visit.any("cycles since a change", since_change_[object->index]), visit.any("changes", state.changed);
      for (Unchanged& unchanged : state.unchanged) {
        visit.number("centre of what is unchanged", unchanged.centre);
        visit.checked(
            "radius of what is unchanged", unchanged.squared_radius, [](double x) { return x >= 0; }, "at least 0");
        visit.flag("flag of what is unchanged", unchanged.appeared);
      }
      for (Placement* placement : {&state.placement, &state.before}) {
        Placement::Numbers numbers = placement->numbers();
        visit.checked(
            "placement", numbers, [](const Placement::Numbers& all) { return Placement{all}.valid(); },
            "scale, rotation and translation");
        *placement = Placement{numbers};
      }
      visit.flag("flag of an object", state.moved);
    }
    visit.any("objects near", near_), visit.any("objects that moved", wandering_);
    for (Tip& tip : tips_) visit.any("position of a tip", tip.position), visit.any("velocity of a tip", tip.velocity);
    for (SphereTouch& sphere : spheres_) sphere.for_each_carried(visit);
    const auto can_move = [this](std::uint32_t object) { return this->can_move(object); };
    for (HeldObject& held : held_) held.for_each_carried(visit, can_move);
    for (haptics::ForceRenderer& force : forces_) force.for_each_carried(visit);
    visit.choice("fault", stopped_, haptics::Fault::kNone, haptics::Fault::kTooFast);
    for (ProbeOutput& output : result_.probes) {
      visit.flag("flag of a probe", output.active);
      visit.number("proxy of a probe", output.proxy);
      for (Plain3* vector : {&output.device, &output.velocity, &output.force, &output.torque, &output.normal})
        visit.any("vector of a probe", *vector);
      visit.any("orientation of a probe", output.orientation);
      for (std::uint32_t* number : {&output.object, &output.status, &output.contacts, &output.pose_sequence})
        visit.any("number of a probe", *number);
      for (float* number : {&output.stiffness, &output.error_bound, &output.pose_age})
        visit.any("number of a probe", *number);
    }
    CycleCosts& costs = result_.costs;
    for (std::uint32_t* cost : {&costs.load, &costs.refine, &costs.refit, &costs.query, &costs.force, &costs.arrivals,
                                &costs.visits, &costs.changes, &costs.nodes_marked, &costs.granted, &costs.foreseen})
      visit.any("cost", *cost);
    visit.any("interventions", result_.interventions);
    visit.flag("flag of a cycle", result_.budget_spent), visit.flag("flag of a cycle", result_.nodes_full);
    visit.flag("flag of a cycle", result_.targets_dropped);
    for (ToolTouch& tool : tools_) tool.for_each_carried(visit);
  }

  /// Sets the pose of an object for the next `touch`: its probes move with it or are pushed. May be called before each
  /// `touch`. Ignores a pose that is not finite. From then on the object counts as near every tip. Realtime.
  void move(const TouchObject& object, const Placement& placement) noexcept;

  /// Takes the regions that arrived and computes the forces. `now_ns` is the time in the log.
  const CycleResult& touch(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns,
                           const Arrival* arrivals, std::uint32_t arrival_count) noexcept;

  /// Refines and refits for the next `touch`, where the tips of the last `touch` will be.
  const CycleResult& refine(spm::Budget budget, const RefineLimit& limit = {}) noexcept;

  /// `refine`, then `touch`: the same sequence of calls, but it ends while the mesh is the one that was touched.
  const CycleResult& step(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns,
                          const Arrival* arrivals, std::uint32_t arrival_count, spm::Budget budget) noexcept {
    refine(budget);
    return touch(probes, now_ns, arrivals, arrival_count);
  }

  /// The reference stays valid; each part is the result of the last call of its function.
  [[nodiscard]] const CycleResult& result() const noexcept { return result_; }

  /// Zero force on every probe until reset_faults, also on probes that come later. Realtime.
  void stop(haptics::Fault fault) noexcept;
  /// Ends the faults; forces start softly again.
  void reset_faults() noexcept;

  /// Without those that are withdrawn.
  [[nodiscard]] const std::vector<TouchObject*>& objects() const noexcept { return objects_; }
  /// The withdrawn objects that still have nodes or records in use.
  [[nodiscard]] const std::vector<TouchObject*>& leaving() const noexcept { return leaving_; }
  /// How often `objects` has changed.
  [[nodiscard]] std::uint64_t objects_changed() const noexcept { return objects_changed_; }
  /// The state of a probe after the last `touch`. Copies of it allow computing the force for another pose or mesh. The
  /// surface is valid until the next `touch`.
  [[nodiscard]] const haptics::Proxy& proxy(std::uint32_t probe) const noexcept { return spheres_[probe].proxy(); }
  using Held = hrtc_service::Held;
  [[nodiscard]] const Held& held(std::uint32_t probe) const noexcept { return held_[probe].held(); }
  /// Null without a tool.
  [[nodiscard]] const ToolTouch* tool(std::uint32_t probe) const noexcept {
    return tools_.empty() ? nullptr : &tools_[probe];
  }
  [[nodiscard]] const haptics::ForceRenderer& renderer(std::uint32_t probe) const noexcept { return forces_[probe]; }
  [[nodiscard]] haptics::Surface& surface(std::uint32_t probe) noexcept { return surfaces_[probe]; }
  /// Log entries that were lost because the ring was full.
  [[nodiscard]] std::uint64_t log_dropped() const noexcept { return query_.log_dropped(); }

 private:
  /// Units granted at a time: eight records, a microsecond's work when they are in the cache.
  static constexpr std::uint32_t kPortion = 8 * (spm::Budget::kVisit + spm::Budget::kChange);
  /// Units of each cycle that take apart what leaves: 32 records, so that others are refined meanwhile.
  static constexpr std::uint32_t kForLeaving = 4 * kPortion;
  struct Tip {
    Vec3d position, velocity;  // world
  };
  struct ObjectState {
    std::uint32_t changed = 0;                      // probes near whose proxies it changed, by bit
    std::array<Unchanged, kMaxProbes> unchanged{};  // around the proxies
    Placement placement, before;
    bool moved = false;  // since the last touch
  };
  [[nodiscard]] bool is_near(std::uint32_t probe, const TouchObject& object) const noexcept {
    return (near_[probe] >> object.index & 1u) != 0;
  }
  [[nodiscard]] bool can_move(std::uint32_t object) const noexcept { return (movable_ >> object & 1u) != 0; }
  [[nodiscard]] const Placement& placement(const TouchObject& object) const noexcept {
    return states_[object.index].placement;
  }
  [[nodiscard]] const TouchObject& object(std::uint32_t index) const noexcept;
  /// Calls `visit` with the SphereTouch or the ToolTouch of the probe.
  template <class Visit>
  decltype(auto) with_probe(std::uint32_t number, Visit&& visit) noexcept {
    return tools_.empty() ? visit(spheres_[number]) : visit(tools_[number]);
  }

  void take(const Arrival& arrival) noexcept;
  void withdraw(TouchObject& object) noexcept;
  void take_away(std::uint32_t probe) noexcept;
  [[nodiscard]] bool gather_surface(std::uint32_t probe) noexcept;
  void render(std::uint32_t probe, const ProbeInput& input, ProbeOutput& output) noexcept;
  void add_force(const haptics::ForceResult& force, ProbeOutput& output) noexcept;
  void select_targets(TouchObject& object) noexcept;
  void add_probe_targets(std::uint32_t probe, const TouchObject& object) noexcept;
  void add_targets_under_bodies(const TouchObject& object) noexcept;
  void take_apart(spm::Budget& budget, spm::Budget& granted, const RefineLimit& limit, double& began) noexcept;
  std::uint32_t count_work(const spm::Forest& forest, const spm::ForestCounters& before) noexcept;
  void depart() noexcept;
  [[nodiscard]] spm::Advance advance(TouchObject& object, spm::Budget& budget, spm::Budget& granted,
                                     const RefineLimit& limit, double& began) noexcept;
  void note_changes(const TouchObject& object, std::uint32_t changes, bool appeared) noexcept;
  void give_back(TouchObject& object) noexcept;
  [[nodiscard]] std::uint32_t refit(TouchObject& object) noexcept;

  CycleSettings settings_;
  DepartureRing& departures_;
  CycleObserver* observer_ = nullptr;
  std::vector<TouchObject*> objects_, leaving_;  // reserved for kMaxObjects
  std::uint64_t objects_changed_ = 0;
  std::array<ObjectState, kMaxObjects> states_{};          // by object index
  std::array<std::uint32_t, kMaxObjects> since_change_{};  // cycles, of the mesh, by object index
  std::array<std::uint64_t, kMaxProbes> near_{};           // objects that a tip could touch, by index bit
  std::uint64_t wandering_ = 0;                            // objects that have moved, by index bit
  std::array<Tip, kMaxProbes> tips_{};                     // of the last touch
  std::int64_t touch_began_ns_ = 0;
  std::uint64_t movable_ = 0;  // objects, by index bit; set when they are added
  std::uint32_t movable_count_ = 0;
  std::vector<SphereTouch> spheres_;                // by probe
  std::deque<ToolTouch> tools_;                     // by probe; none without a tool
  std::array<HeldObject, kMaxProbes> held_;         // by probe
  double reach_ = haptics::ProxySettings{}.reach;   // m, of the proxies; increases with the objects added
  std::vector<haptics::ForceRenderer> forces_;      // by probe
  haptics::Fault stopped_ = haptics::Fault::kNone;  // all of them
  std::array<ObjectsSurface, kMaxProbes> surfaces_;
  spm::CandidateCaches candidate_caches_;  // of all of them
  ContactQuery query_;
  spm::TargetSelection targets_;
  std::vector<Departure> left_;  // in this cycle; capacity reserved as large as the ring
  CycleResult result_;
};

}  // namespace tactus::hrtc_service
