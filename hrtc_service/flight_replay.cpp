#include "hrtc_service/flight_replay.hpp"

#include <xmmintrin.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "hrtc_service/flight_check.hpp"
#include "hrtc_service/servo/build_id.hpp"
#include "hrtc_service/servo/flight_recorder.hpp"
#include "hrtc_service/servo/touch_objects.hpp"
#include "spm/codec/load_region.hpp"
#include "spm/directory.hpp"

namespace tactus::hrtc_service {
namespace {

using trace::FlightError;

/// The error of a recorded call that is impossible in the replayed state.
class ImpossibleCall : public FlightError {
 public:
  using FlightError::FlightError;
};

/// Restores the processor's treatment of denormals and rounding at the end of its lifetime.
class FloatControl {
 public:
  FloatControl() : before_{_mm_getcsr()} {}
  ~FloatControl() { _mm_setcsr(before_); }
  FloatControl(const FloatControl&) = delete;
  FloatControl& operator=(const FloatControl&) = delete;
  void set(std::uint32_t control) noexcept { _mm_setcsr((_mm_getcsr() & ~0xffc0u) | (control & 0xffc0u)); }

 private:
  unsigned before_;
};

std::string text(const std::array<double, 3>& v) {
  std::array<char, 96> out{};
  std::snprintf(out.data(), out.size(), "(%.17g, %.17g, %.17g)", v[0], v[1], v[2]);
  return out.data();
}

std::string recorded_and_replayed(const std::string& what, const std::array<double, 3>& recorded,
                                  const std::array<double, 3>& replayed, const std::string& unit) {
  return "recorded " + what + " " + text(recorded) + " " + unit + ", replayed " + what + " " + text(replayed) + " " +
         unit;
}

template <class Value>
bool is_same(const Value& a, const Value& b) noexcept {
  return std::memcmp(&a, &b, sizeof a) == 0;
}

CycleSettings settings_of(const trace::FlightStart& start, const spm::MeshProbe* tool) {
  CycleSettings settings;
  settings.period = start.period;
  settings.radius = start.tip_radius;
  settings.tool = tool;
  settings.refine_margin = start.refine_margin;
  settings.retain_margin = start.retain_margin;
  settings.refine_ahead = start.refine_ahead;
  if (start.targets == 0 || start.targets > CycleSettings::kMaxTargets)
    throw FlightError("found " + std::to_string(start.targets) + " targets, expected 1 to " +
                      std::to_string(CycleSettings::kMaxTargets));
  settings.targets = start.targets;
  settings.force = {
      start.max_force,      start.max_slew,  start.soft_start, start.recovery,        start.max_fresh_age,
      start.zero_force_age, start.max_speed, start.max_torque, start.max_torque_slew, start.max_angular_velocity};
  return settings;
}

std::array<haptics::DeviceSpec, kMaxProbes> specs_of(const trace::FlightStart& start) {
  std::array<haptics::DeviceSpec, kMaxProbes> specs;
  for (std::uint32_t i = 0; i < kMaxProbes; ++i) {
    const trace::FlightLimits& limits = start.devices[i];
    specs[i] = {limits.max_force,        limits.max_stiffness, limits.damping,
                limits.workspace_radius, limits.max_torque,    limits.max_rotational_stiffness};
  }
  return specs;
}

std::unique_ptr<const spm::MeshProbe> tool_of(const trace::FlightStart& start) {
  if (start.tool_triangles.empty()) return nullptr;
  std::vector<std::array<float, 3>> vertices(start.tool_vertices.size() / 3);
  std::vector<std::array<std::uint32_t, 3>> triangles(start.tool_triangles.size() / 3);
  for (std::size_t i = 0; i < 3 * vertices.size(); ++i) vertices[i / 3][i % 3] = start.tool_vertices[i];
  for (std::size_t i = 0; i < 3 * triangles.size(); ++i) triangles[i / 3][i % 3] = start.tool_triangles[i];
  try {
    return std::make_unique<const spm::MeshProbe>(vertices, triangles);
  } catch (const std::invalid_argument& error) {
    throw FlightError(std::string{"found no tool: "} + error.what());
  }
}

ProbeInput input_of(const trace::FlightProbe& probe) {
  ProbeInput input;
  input.active = true;
  input.device.position = vec(probe.position);
  input.device.velocity = vec(probe.velocity);
  input.device.orientation =
      Eigen::Quaterniond{probe.orientation[3], probe.orientation[0], probe.orientation[1], probe.orientation[2]};
  input.device.buttons = probe.buttons;
  input.device.time_ns = probe.pose_time_ns;
  input.device.sequence = probe.pose_sequence;
  input.device.transit = probe.transit;
  input.device.round_trip = probe.round_trip;
  input.pose_age = probe.pose_age;
  input.near = {probe.near_found, probe.near_searched, probe.near_centre, probe.near_valid_radius};
  input.failed = probe.failed != 0;
  return input;
}

/// A Cycle with its memory. Its regions come from models instead of a loader.
class World {
 public:
  explicit World(const trace::FlightStart& start)
      : objects_{pool_settings(start)},
        tool_{tool_of(start)},
        cycle_{settings_of(start, tool_.get()), specs_of(start), departures_, nullptr} {}

  [[nodiscard]] Cycle& cycle() noexcept { return cycle_; }

  /// Returns an object. Throws FlightError before its arrival, and ImpossibleCall if it is withdrawn. `number`: below
  /// kMaxObjects.
  [[nodiscard]] TouchObject& object(std::uint32_t number) {
    if (models_[number] == nullptr) throw FlightError("found object " + std::to_string(number) + " before its arrival");
    TouchObject* const touch = objects_.find(number);
    if (touch == nullptr) throw ImpossibleCall("object " + std::to_string(number) + " has been withdrawn");
    return *touch;
  }

  [[nodiscard]] Arrival add(const trace::FlightObject& described, const spm::codec::CompressedModel& model) {
    const spm::BaseMesh& base = model.base();
    if (models_[described.object] != nullptr)
      throw ImpossibleCall("object '" + described.name + "' comes as number " + std::to_string(described.object) +
                           ", which another object has");
    ObjectDescription description;
    description.index = described.object;
    description.id = described.id;
    description.digest = described.digest;
    description.name = described.name;
    description.placement = Placement{described.placement};
    description.material = {described.stiffness, described.damping, described.static_friction,
                            described.dynamic_friction};
    if (described.movable) description.body = sharing::body_of_bounds(base.summary, description.placement.scale());
    const std::optional<Arrival> arrival = objects_.add(description, base, spm::kMaxObjectPages);
    if (!arrival) throw FlightError("object '" + described.name + "' does not fit as it did");
    models_[described.object] = &model;
    return *arrival;
  }

  [[nodiscard]] Arrival page(std::uint32_t number, spm::PageId page) {
    const TouchObject& touch = object(number);
    Arrival arrival;
    if (objects_.add_page(number, spm::page_with_id(models_[number]->regions(), page), arrival) !=
        spm::AcceptResult::kAccepted)
      throw ImpossibleCall("page " + std::to_string(spm::index(page)) + " of object '" + touch.name +
                           "' cannot have come");
    return arrival;
  }

  [[nodiscard]] Arrival page_drop(std::uint32_t number, spm::PageId page) {
    const TouchObject& touch = object(number);
    const std::optional<Arrival> arrival = objects_.drop_page(number, page);
    if (!arrival)
      throw ImpossibleCall("page " + std::to_string(spm::index(page)) + " of object '" + touch.name +
                           "' is not here to be dropped");
    return *arrival;
  }

  [[nodiscard]] Arrival region(std::uint32_t number, spm::RegionId region) {
    const TouchObject& touch = object(number);
    const spm::codec::CompressedModel& model = *models_[number];
    const spm::Cache& cache = objects_.cache();
    const spm::ObjectIndex cache_index = objects_.cache_index(number);
    if (spm::index(region) >= model.summary().regions || cache.is_loaded(cache_index, region))
      throw ImpossibleCall("region " + std::to_string(spm::index(region)) + " of object '" + touch.name +
                           "' cannot have come");
    Arrival arrival;
    const std::optional<spm::RegionData> data = spm::codec::region_data(model, region, cache, cache_index);
    const spm::ListSummary expected = spm::list_summary(model.regions()[spm::index(region)]);
    if (!data || objects_.add_region(number, *data, expected, arrival) != spm::AcceptResult::kAccepted)
      throw ImpossibleCall("region " + std::to_string(spm::index(region)) + " of object '" + touch.name +
                           "' does not fit as it did");
    return arrival;
  }

  [[nodiscard]] Arrival retirement(std::uint32_t number, spm::RegionId region) {
    const TouchObject& touch = object(number);
    const std::optional<Arrival> arrival = objects_.retire(number, region);
    if (!arrival)
      throw ImpossibleCall("region " + std::to_string(spm::index(region)) + " of object '" + touch.name +
                           "' is not here to be retired");
    return *arrival;
  }

  [[nodiscard]] Arrival withdrawal(std::uint32_t number) {
    (void)object(number);
    return *objects_.withdraw(number);
  }

  /// Frees the departed regions and objects, and returns their number. The recorded run freed them at this time or
  /// later.
  std::uint64_t release() {
    std::uint64_t released = 0;
    for (Departure departure; departures_.pop(departure); ++released) {
      objects_.free(departure);
      if (departure.is_object()) models_[departure.object] = nullptr;
    }
    return released;
  }

  void touch(const std::array<ProbeInput, kMaxProbes>& probes, std::int64_t now_ns,
             const std::vector<Arrival>& arrivals) {
    static_cast<void>(cycle_.touch(probes, now_ns, arrivals.data(), static_cast<std::uint32_t>(arrivals.size())));
  }

  /// Restores a recorded state. Before this call, the cycle must have processed the arrivals of the state's objects,
  /// and nothing else.
  void restore(const trace::FlightState& state) {
    for (const trace::FlightObjectState& recorded : state.objects) {
      spm::Forest& forest = *object(recorded.object).forest;
      for (const std::uint32_t loaded : recorded.loaded_pages)
        forest.add(*page(recorded.object, spm::PageId{loaded}).page);
      for (const std::uint32_t loaded : recorded.loaded_regions)
        forest.add(spm::RegionId{loaded}, region(recorded.object, spm::RegionId{loaded}).list);
      std::vector<spm::Forest::InUse> in_use;
      for (const trace::FlightRegion& one : recorded.in_use) {
        in_use.push_back({spm::RegionId{one.region}, one.applied, one.retiring, one.retained});
        if (one.retiring) (void)objects_.retire(recorded.object, spm::RegionId{one.region});
      }
      if (!forest.restore(recorded.base_faces, in_use.data(), static_cast<std::uint32_t>(in_use.size())) ||
          forest.mesh_hash() != recorded.mesh_hash)
        throw FlightError("object '" + object(recorded.object).name + "' cannot be brought to the state of cycle " +
                          std::to_string(state.cycle));
    }
    haptics::CarriedReader reader{state.carried};
    cycle_.for_each_carried(reader);
    if (const std::string error = reader.error(); !error.empty()) throw FlightError(error);
  }

 private:
  static spm::PoolSettings pool_settings(const trace::FlightStart& start) {
    spm::PoolSettings settings = spm::PoolSettings::for_slots(start.slots);
    settings.tree_nodes = start.tree_nodes;
    settings.list_blocks = start.list_blocks;
    return settings;
  }

  TouchObjects objects_;
  std::unique_ptr<const spm::MeshProbe> tool_;
  DepartureRing departures_{1u << 16};
  std::array<const spm::codec::CompressedModel*, kMaxObjects> models_{};  // by number of the object; null: none
  Cycle cycle_;
};

class Replay {
 public:
  Replay(const std::filesystem::path& file, const FlightReplayOptions& options)
      : options_{options}, name_{file.string()}, reader_{file} {}

  FlightReport run() {
    trace::FlightMessage message;
    try {
      while (reader_.next(message)) {
        expect_valid(message, options_.max_pool_bytes);
        std::visit([this](const auto& value) { process(value); }, message);
      }
      end_cycle();
    } catch (const ImpossibleCall& error) {
      end_cycle();
      if (report_.different_cycles == 0)
        throw FlightError(name_ + ", after cycle " + std::to_string(cycle_) + ": " + error.what());
      report_.abort_reason = "cycle " + std::to_string(cycle_) + ", " + error.what();
    } catch (const FlightError& error) {
      throw FlightError(name_ + ", after cycle " + std::to_string(cycle_) + ": " + error.what());
    }
    if (!started_) throw FlightError(name_ + ": found no flight recording in it");
    if (report_.cycles == 0 && report_.different_cycles == 0)
      throw FlightError(name_ + ": found no complete cycle in it");
    report_.is_truncated = reader_.is_truncated();
    report_.seconds = static_cast<double>(last_ns_ - first_ns_) * 1e-9;
    return std::move(report_);
  }

 private:
  void process(const trace::FlightStart& start) {
    if (started_) throw FlightError("found a second start");
    started_ = true;
    report_.start = start;
    report_.from_the_beginning = true;  // until a state follows
    if (start.build != build_id() && !options_.accepts_any_build)
      throw FlightError("recorded by build " + start.build + ", this is build " + build_id() +
                        ": only the same build computes the same forces to the bit");
    world_ = std::make_unique<World>(start);
  }

  void process(const trace::FlightObject& object) { objects_[object.object] = object; }

  void process(const trace::FlightState& state) {
    if (report_.cycles == 0) report_.from_the_beginning = false;
    if (report_.start.build != build_id())
      throw FlightError("begins in the middle of a run, with a state that only build " + report_.start.build +
                        " reads");
    if (state.lost > 0) ++report_.gaps;
    report_.lost += state.lost;
    world_ = std::make_unique<World>(report_.start);
    std::vector<Arrival> objects;
    for (const trace::FlightObjectState& object : state.objects) objects.push_back(object_arrival(object.object));
    world_->touch({}, 0, objects);
    world_->restore(state);
    inputs_ = {};
    probes_.clear();
    arrivals_.clear();
  }

  void process(const trace::FlightEvent& event) {
    expect_start();
    using enum trace::FlightEvent::Kind;
    const spm::RegionId region{event.region};
    switch (event.kind) {
      case kStopped:
        ++report_.stops;
        return world().stop(static_cast<haptics::Fault>(event.fault));
      case kReset:
        ++report_.resets;
        return world().reset_faults();
      case kObjectArrived:
        arrivals_.push_back(object_arrival(event.object));
        return;
      case kRegionArrived:
        ++report_.regions_arrived;
        arrivals_.push_back(world_->region(event.object, region));
        return;
      case kPageArrived:
        arrivals_.push_back(world_->page(event.object, spm::PageId{event.region}));
        return;
      case kPageDropped:
        arrivals_.push_back(world_->page_drop(event.object, spm::PageId{event.region}));
        return;
      case kRegionRetired:
        arrivals_.push_back(world_->retirement(event.object, region));
        return;
      case kObjectWithdrawn:
        ++report_.objects_withdrawn;
        arrivals_.push_back(world_->withdrawal(event.object));
        return;
      case kPageDeparted:
      case kRegionDeparted:
      case kObjectDeparted:
        ++recorded_departures_;
        return;
    }
  }

  void process(const trace::FlightMove& move) {
    expect_start();
    ++report_.moves;
    world().move(world_->object(move.object), Placement{move.placement});
  }

  void process(const trace::FlightProbe& probe) {
    inputs_[probe.probe] = input_of(probe);
    probes_.push_back(probe);
  }

  void process(const trace::FlightTouch& touch) {
    expect_start();
    end_cycle();
    cycle_ = touch.cycle;
    control_.set(touch.float_control);
    world_->touch(inputs_, touch.time_ns, arrivals_);
    for (const trace::FlightProbe& probe : probes_) compare(touch, probe, world().result().probes[probe.probe]);
    if (first_ns_ == 0) first_ns_ = touch.time_ns;
    last_ns_ = touch.time_ns;
    inputs_ = {};
    probes_.clear();
    arrivals_.clear();
  }

  void process(const trace::FlightRefine& refine) {
    expect_start();
    cycle_ = refine.cycle;
    const CycleResult& result = world().refine(spm::Budget{refine.granted});
    std::uint64_t hash = 0;
    for (const TouchObject* object : world().objects()) hash = flight_hash(hash, object->forest->mesh_hash());
    if (refine.caches_emptied != 0) world().clear_gathered_pairs();
    const std::uint64_t departures = world_->release();
    if (hash != refine.mesh_hash) add_difference("the mesh differs");
    if (departures != recorded_departures_)
      add_difference("recorded " + std::to_string(recorded_departures_) + " departures, replayed " +
                     std::to_string(departures));
    std::string differences;
    const auto compare_refinement = [&](const char* name, std::uint32_t recorded, std::uint32_t replayed) {
      if (recorded != replayed)
        differences += std::string{"; recorded "} + name + " " + std::to_string(recorded) + ", replayed " +
                       std::to_string(replayed);
    };
    compare_refinement("units", refine.granted, result.costs.granted);
    compare_refinement("budget_spent", refine.budget_spent != 0 ? 1 : 0, result.budget_spent ? 1 : 0);
    compare_refinement("nodes_full", refine.nodes_full != 0 ? 1 : 0, result.nodes_full ? 1 : 0);
    if (!differences.empty()) add_difference("refinement differs" + differences);
    report_.regions_departed += departures;
    report_.budget_spent += result.budget_spent ? 1 : 0;
    recorded_departures_ = 0;
    ++report_.cycles;
    end_cycle();
  }

  /// Counts the difference of the newest cycle, also if the recording ends or has a gap before its refinement.
  void end_cycle() noexcept {
    if (cycle_differs_) ++report_.different_cycles;
    cycle_differs_ = false;
  }

  void compare(const trace::FlightTouch& touch, const trace::FlightProbe& recorded, const ProbeOutput& replayed) {
    const std::string who = "probe " + std::to_string(recorded.probe) + ": ";
    if (!is_same(recorded.force, replayed.force))
      add_difference(who + recorded_and_replayed("force", recorded.force, replayed.force, "N"));
    else if (!is_same(recorded.torque, replayed.torque))
      add_difference(who + recorded_and_replayed("torque", recorded.torque, replayed.torque, "N m"));
    else if (!is_same(recorded.proxy, replayed.proxy))
      add_difference(who + recorded_and_replayed("proxy", recorded.proxy, replayed.proxy, "m"));
    else if (!is_same(recorded.proxy_orientation, replayed.orientation))
      add_difference(who + "the orientations of the proxies differ");
    else if (recorded.status != replayed.status || recorded.touched_object != replayed.object ||
             recorded.contacts != replayed.contacts)
      add_difference(who + "status, object or contacts differ");
    const auto has = [&](std::uint32_t bits) { return (recorded.status & bits) == bits ? 1u : 0u; };
    ++report_.probe_cycles;
    report_.in_contact += has(session::kInContact);
    report_.exact += has(session::kInContact | session::kExact);
    report_.stale += has(session::kStalePose);
    report_.faulted += has(session::kFault);
    if (options_.on_probe) options_.on_probe(touch, recorded, replayed);
  }

  void add_difference(const std::string& what) {
    cycle_differs_ = true;
    if (report_.first_difference.empty()) report_.first_difference = "cycle " + std::to_string(cycle_) + ", " + what;
  }

  Arrival object_arrival(std::uint32_t number) {
    const auto described = objects_.find(number);
    if (described == objects_.end())
      throw FlightError("found object " + std::to_string(number) + ", which is not described");
    const trace::FlightObject& object = described->second;
    const spm::codec::CompressedModel* const model = options_.model(object.digest);
    if (model == nullptr) {
      std::array<char, 32> digest{};
      std::snprintf(digest.data(), digest.size(), "%016llx", static_cast<unsigned long long>(object.digest));
      throw FlightError("object '" + object.name + "' is of the model with digest " + digest.data() +
                        ", which is not among those given");
    }
    ++report_.objects;
    return world_->add(object, *model);
  }

  void expect_start() const {
    if (!started_) throw FlightError("found a cycle before the start");
  }
  [[nodiscard]] Cycle& world() noexcept { return world_->cycle(); }

  const FlightReplayOptions& options_;
  std::string name_;
  trace::FlightFileReader reader_;
  FloatControl control_;
  FlightReport report_;
  bool started_ = false, cycle_differs_ = false;
  std::unique_ptr<World> world_;
  std::map<std::uint32_t, trace::FlightObject> objects_;
  std::array<ProbeInput, kMaxProbes> inputs_;
  std::vector<trace::FlightProbe> probes_;
  std::vector<Arrival> arrivals_;
  std::uint64_t cycle_ = 0, recorded_departures_ = 0;
  std::int64_t first_ns_ = 0, last_ns_ = 0;
};

}  // namespace

FlightReport replay_flight(const std::filesystem::path& file, const FlightReplayOptions& options) {
  return Replay{file, options}.run();
}

}  // namespace tactus::hrtc_service
