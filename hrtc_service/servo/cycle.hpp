/// One haptic cycle: computes forces from the newest device positions, and refines the mesh at the predicted positions
/// of the tips.
///
///   arrivals -> query -> proxy -> force  |  select -> refine within the limit -> refit
///      T_L       T_Q          T_F        |              T_R                        T_B
///   touch -------------------------------|- refine ----------------------------------
///
/// A hand whose grab button is down holds the movable object that it touches. From the next `touch` until the button
/// is up, the hand is coupled to the contact point and the orientation of the object, and not to its surface.
///
/// Probes no longer touch a withdrawn object, and its forces on hands decrease to zero. A share of each cycle's budget
/// removes its mesh. After that, the cycle returns the object to the intake, and its index can be used again.
///
/// Results depend only on the arguments of `touch` and `refine` and on the earlier calls, except that a clock may end
/// refinement. `refine` reports the budget that it used until then. With that budget and without a clock, it computes
/// the same results to the bit. So cycles can be recorded and replayed (flight_recorder.hpp).
/// Realtime. Haptic thread.
///
/// The paper refines first and then queries. The order here publishes forces sooner, and the time left for refinement
/// is known. A refined mesh is touched one cycle later, so refinement predicts the tip's position in the next cycle.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "haptics/carried.hpp"
#include "haptics/force.hpp"
#include "hrtc_service/servo/contact_query.hpp"
#include "hrtc_service/servo/governor.hpp"
#include "hrtc_service/servo/held_object.hpp"
#include "hrtc_service/servo/probe.hpp"
#include "hrtc_service/servo/sphere_touch.hpp"
#include "hrtc_service/servo/tool_touch.hpp"
#include "hrtc_service/servo/touch_object.hpp"
#include "spm/target_selection.hpp"

namespace tactus::hrtc_service {

struct CycleSettings {
  static constexpr std::uint32_t kMaxTargets = 1u << 16;

  double period = 0.001;  ///< s
  double radius = 0.003;  ///< radius of every tip, m
  /// Tool of every probe, m; must outlive the cycle. Null: every probe is a sphere.
  const spm::MeshProbe* tool = nullptr;
  /// Regions within this distance of a tip, or of its predicted path, are refined, m.
  double refine_margin = 0.0005;
  /// Refined regions are coarsened beyond this distance of a tip, m. It is larger than refine_margin, so that a
  /// trembling tip does not refine and coarsen them in turn.
  double retain_margin = 0.002;
  /// Time for which refinement covers the predicted motion of a tip, s.
  double refine_ahead = 0.01;
  /// Max number of refined regions of an object, 1 to kMaxTargets. If more are needed, the least urgent remain coarse,
  /// and session::kTargetsDropped is set.
  std::uint32_t targets = 1024;
  haptics::ForceSettings force;
};

/// Costs of one cycle. `visits`: visited list entries. `changes`: splits and collapses. `nodes_marked`: refitted nodes.
struct CycleCosts {
  std::uint32_t load = 0, refine = 0, refit = 0, query = 0, force = 0;  ///< ns
  std::uint32_t arrivals = 0, visits = 0, changes = 0, nodes_marked = 0;
  std::uint32_t granted = 0;          ///< units of Budget that the clock permitted; the budget of a replay
  std::uint32_t predicted_total = 0;  ///< time of the cycle, predicted when its last portion began, ns; 0: no portion
  [[nodiscard]] std::uint32_t total() const noexcept { return load + refine + refit + query + force; }
};

struct CycleResult {
  std::array<ProbeOutput, kMaxProbes> probes;
  CycleCosts costs;
  /// Number of times that each haptics::ForceBit was set since the start, sum over all probes.
  std::array<std::uint32_t, haptics::kForceBits> interventions{};
  bool budget_spent = false;
  bool nodes_full = false;
  bool targets_dropped = false;  ///< more regions were needed than CycleSettings::targets
};

class Cycle;

/// Receives every call of a cycle that can change later results, in order and with its result. Realtime.
class CycleObserver {
 public:
  virtual ~CycleObserver() = default;
  virtual void stopped(haptics::Fault fault) noexcept = 0;
  virtual void reset() noexcept = 0;
  virtual void moved(const TouchObject& object, const Placement& placement) noexcept = 0;
  virtual void touched(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns, const Arrival* arrivals,
                       std::uint32_t arrival_count, const CycleResult& result) noexcept = 0;
  /// `departed`: the regions, pages and objects returned to the intake. `departures_fit`: the ring of departures is not
  /// full.
  virtual void refined(Cycle& cycle, std::span<const Departure> departed, bool departures_fit) noexcept = 0;
};

class Cycle {
 public:
  using LogRing = ContactQuery::LogRing;

  /// `specs`: limits of each probe's device, in world units. `departures` and, when not null, `log` must outlive the
  /// cycle. Not realtime.
  Cycle(const CycleSettings& settings, const std::array<haptics::DeviceSpec, kMaxProbes>& specs,
        DepartureRing& departures, LogRing* log);

  /// `observer` must outlive the cycle. Not realtime.
  void set_observer(CycleObserver* observer) noexcept { observer_ = observer; }
  /// Discards the pairs of triangles that each tool has gathered. `for_each_carried` does so, too. The recorder calls
  /// this function when a state is due, because a replay starts from that state without the pairs. Realtime.
  void clear_gathered_pairs() noexcept {
    for (ToolTouch& tool : tools_) tool.tool().clear_gathered_pairs();
  }
  /// Visits all state that one cycle passes to the next, except the meshes (haptics/carried.hpp). From this state, a
  /// cycle of the same build, settings and objects computes the same results. Realtime if `visit` is.
  template <class Visit>
  void for_each_carried(Visit& visit) noexcept {
    static_assert(sizeof(ObjectState) == 544 && sizeof(ProbeOutput) == 216 && sizeof(CycleCosts) == 44,
                  "carry the new member");
    for (const TouchObject* object : objects_) {
      ObjectState& state = states_[object->index];
      visit.any("cycles since a change", cycles_since_change_[object->index]), visit.any("changes", state.changed);
      for (UnchangedSphere& unchanged : state.unchanged) {
        visit.number("centre of an unchanged sphere", unchanged.centre);
        visit.checked(
            "radius of an unchanged sphere", unchanged.squared_radius, [](double x) { return x >= 0; }, "at least 0");
        visit.flag("flag of an unchanged sphere", unchanged.appeared);
      }
      for (Placement* placement : {&state.placement, &state.previous_placement}) {
        Placement::Numbers numbers = placement->numbers();
        visit.checked(
            "placement", numbers, [](const Placement::Numbers& all) { return Placement{all}.valid(); },
            "scale, rotation and translation");
        *placement = Placement{numbers};
      }
      visit.flag("flag of an object", state.moved);
    }
    visit.any("objects near", near_), visit.any("objects that moved", moved_objects_);
    for (Tip& tip : tips_) visit.any("position of a tip", tip.position), visit.any("velocity of a tip", tip.velocity);
    for (SphereTouch& sphere : spheres_) sphere.for_each_carried(visit);
    const auto can_move = [this](std::uint32_t object) { return this->can_move(object); };
    for (HeldObject& held : held_) held.for_each_carried(visit, can_move);
    for (haptics::ForceRenderer& force : forces_) force.for_each_carried(visit);
    visit.choice("fault", stop_fault_, haptics::Fault::kNone, haptics::kLastFault);
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
    for (std::uint32_t* cost :
         {&costs.load, &costs.refine, &costs.refit, &costs.query, &costs.force, &costs.arrivals, &costs.visits,
          &costs.changes, &costs.nodes_marked, &costs.granted, &costs.predicted_total})
      visit.any("cost", *cost);
    visit.any("interventions", result_.interventions);
    visit.flag("flag of a cycle", result_.budget_spent), visit.flag("flag of a cycle", result_.nodes_full);
    visit.flag("flag of a cycle", result_.targets_dropped);
    for (ToolTouch& tool : tools_) tool.for_each_carried(visit);
  }

  /// Sets the pose of an object. In the next `touch`, the object moves the proxies that touch it, and pushes the
  /// proxies in its path. If its centre moves by more than kMaxStep, it appears at its new place and pushes none. Only
  /// an object whose pose was unknown moves that far in one cycle. Ignores an invalid pose. From the first call on the
  /// object counts as near every tip. Realtime.
  void move(const TouchObject& object, const Placement& placement) noexcept;
  static constexpr double kMaxStep = 0.05;  ///< m, of an object in a cycle

  /// Processes the arrivals and computes the forces. `now_ns` is the time in the log.
  const CycleResult& touch(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns,
                           const Arrival* arrivals, std::uint32_t arrival_count) noexcept;

  /// Refines and refits the meshes around the predicted positions of the tips in the next `touch`.
  const CycleResult& refine(spm::Budget budget, const RefineLimit& limit = {}) noexcept;

  /// Calls `refine`, then `touch`: the order of the paper. So afterwards the active mesh is still the mesh that was
  /// touched.
  const CycleResult& step(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns,
                          const Arrival* arrivals, std::uint32_t arrival_count, spm::Budget budget) noexcept {
    refine(budget);
    return touch(probes, now_ns, arrivals, arrival_count);
  }

  /// Returns the results of the last `touch` and the last `refine`. The reference remains valid.
  [[nodiscard]] const CycleResult& result() const noexcept { return result_; }

  /// Makes all forces zero until `reset_faults`, also for users who join later. Realtime.
  void stop(haptics::Fault fault) noexcept;
  /// Ends the faults. Forces return with a soft start.
  void reset_faults() noexcept;

  /// Returns the objects that are not withdrawn.
  [[nodiscard]] const std::vector<TouchObject*>& objects() const noexcept { return objects_; }
  /// Returns the withdrawn objects whose nodes and records are still in use.
  [[nodiscard]] const std::vector<TouchObject*>& withdrawn_objects() const noexcept { return withdrawn_; }
  /// Returns whether there is a movable object with this index.
  [[nodiscard]] bool can_move(std::uint32_t object) const noexcept {
    return object < kMaxObjects && (movable_ >> object & 1u) != 0;
  }
  /// Returns the number of changes of `objects`.
  [[nodiscard]] std::uint64_t objects_changed() const noexcept { return objects_changed_; }
  /// Returns the movable objects whose bounds the probe at `proxy` intersects, by index bit. It may touch each of them,
  /// even if its output names another object.
  [[nodiscard]] std::uint64_t movable_objects_at(std::uint32_t probe, const Vec3d& proxy) const noexcept;
  // The state of a probe after the last `touch`. Benchmarks copy it to compute the force for another pose or mesh. The
  // surface is valid until the next `touch`.
  [[nodiscard]] const haptics::Proxy& proxy(std::uint32_t probe) const noexcept { return spheres_[probe].proxy(); }
  using HoldState = hrtc_service::HoldState;
  [[nodiscard]] const HoldState& hold_state(std::uint32_t probe) const noexcept { return held_[probe].state(); }
  /// Returns the tool of a probe, null if probes are spheres.
  [[nodiscard]] const ToolTouch* tool(std::uint32_t probe) const noexcept {
    return tools_.empty() ? nullptr : &tools_[probe];
  }
  [[nodiscard]] const haptics::ForceRenderer& renderer(std::uint32_t probe) const noexcept { return forces_[probe]; }
  [[nodiscard]] haptics::Surface& surface(std::uint32_t probe) noexcept { return surfaces_[probe]; }
  /// Returns the number of log entries that were lost because the ring was full.
  [[nodiscard]] std::uint64_t log_dropped() const noexcept { return query_.log_dropped(); }

 private:
  /// Budget units of one portion: eight records, which take about 1 us if they are in the CPU cache.
  static constexpr std::uint32_t kPortion = 8 * (spm::Budget::kVisit + spm::Budget::kChange);
  /// Budget units in each cycle for withdrawn objects: 32 records.
  static constexpr std::uint32_t kWithdrawnUnits = 4 * kPortion;
  struct Tip {
    Vec3d position, velocity;  // world
  };
  struct ObjectState {
    std::uint32_t changed = 0;                            // by probe bit: the mesh changed near its proxy
    std::array<UnchangedSphere, kMaxProbes> unchanged{};  // around the proxies, by probe
    Placement placement, previous_placement;
    bool moved = false;  // since the last touch
  };
  [[nodiscard]] bool is_near(std::uint32_t probe, const TouchObject& object) const noexcept {
    return (near_[probe] >> object.index & 1u) != 0;
  }
  [[nodiscard]] const Placement& placement(const TouchObject& object) const noexcept {
    return states_[object.index].placement;
  }
  [[nodiscard]] const TouchObject& object(std::uint32_t index) const noexcept;
  /// Calls `visit` with the SphereTouch or the ToolTouch of the probe.
  template <class Visit>
  decltype(auto) with_probe(std::uint32_t number, Visit&& visit) noexcept {
    return tools_.empty() ? visit(spheres_[number]) : visit(tools_[number]);
  }

  void process_arrival(const Arrival& arrival) noexcept;
  void set_reach() noexcept;
  void withdraw(TouchObject& object) noexcept;
  void reset_probe(std::uint32_t probe) noexcept;
  [[nodiscard]] bool gather_surface(std::uint32_t probe) noexcept;
  void render(std::uint32_t probe, const ProbeInput& input, ProbeOutput& output) noexcept;
  void add_force(const haptics::ForceResult& force, ProbeOutput& output) noexcept;
  void select_targets(TouchObject& object) noexcept;
  void add_probe_targets(std::uint32_t probe, const TouchObject& object) noexcept;
  void add_targets_under_bodies(const TouchObject& object) noexcept;
  void coarsen_withdrawn(spm::Budget& budget, spm::Budget& granted, const RefineLimit& limit, double& began) noexcept;
  std::uint32_t count_work(const spm::Forest& forest, const spm::ForestCounters& before) noexcept;
  void return_dropped_pages() noexcept;
  void return_removed_objects() noexcept;
  [[nodiscard]] spm::Advance advance(TouchObject& object, spm::Budget& budget, spm::Budget& granted,
                                     const RefineLimit& limit, double& began) noexcept;
  void reset_changes(const TouchObject& object, std::uint32_t changes, bool appeared) noexcept;
  void return_retired_regions(TouchObject& object) noexcept;
  [[nodiscard]] std::uint32_t refit(TouchObject& object) noexcept;

  CycleSettings settings_;
  double reach_;  // m, of a probe around its proxy
  DepartureRing& departures_;
  CycleObserver* observer_ = nullptr;
  std::vector<TouchObject*> objects_, withdrawn_;  // reserved for kMaxObjects
  std::uint64_t objects_changed_ = 0;
  std::array<ObjectState, kMaxObjects> states_{};                 // by object index
  std::array<std::uint32_t, kMaxObjects> cycles_since_change_{};  // since the mesh changed, by object index
  std::array<std::uint64_t, kMaxProbes> near_{};                  // objects that a tip could touch, by index bit
  std::uint64_t moved_objects_ = 0;     // objects that have moved since their arrival, by index bit
  std::array<Tip, kMaxProbes> tips_{};  // at the last touch
  std::int64_t touch_began_ns_ = 0;
  std::uint64_t movable_ = 0;  // movable objects, by index bit
  std::uint32_t movable_count_ = 0;
  std::vector<SphereTouch> spheres_;                   // by probe
  std::deque<ToolTouch> tools_;                        // by probe; none without a tool
  std::array<HeldObject, kMaxProbes> held_;            // by probe
  std::vector<haptics::ForceRenderer> forces_;         // by probe
  haptics::Fault stop_fault_ = haptics::Fault::kNone;  // fault of all probes
  std::array<ObjectsSurface, kMaxProbes> surfaces_;
  spm::CandidateCaches candidate_caches_;  // shared by the surfaces
  ContactQuery query_;
  spm::TargetSelection targets_;
  std::vector<Departure> departed_;       // departures of this cycle; its capacity is that of the ring
  std::vector<Departure> dropped_pages_;  // to return; fixed capacity
  CycleResult result_;
};

}  // namespace tactus::hrtc_service
